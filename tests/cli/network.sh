#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# brace restore with a network: where weights are looked for, what is said of it, and files that are none.
source "$(dirname "$0")/lib.sh"
make_small
"$helper" network net.safetensors brace-s || exit 1

# A file, by its name; what was done is told.
run 0 restore small -o a.png -o a.dng --model net.safetensors -v --json; cp out r.json
says 'network brace-s'; says '1 tile of'; says 'weights net.safetensors'; exists a.png
is method "$(json r.json method)" brace
is model "$(json r.json network model)" brace-s
is tiles "$(json r.json network tiles)" 1
is weight "$(json r.json inputs 0 weight)" null
ok seconds json r.json seconds network
"$brace" restore small -q -o ref.png --method reference || exit 1
ok 'the network changes the picture' bash -c '! cmp -s a.png ref.png'
ok 'but not much' "$helper" same a.png ref.png 20

# The same bytes with any number of threads, and of any kind of naming.
run 0 restore small -qo b.png --model ./net.safetensors --method brace -t 1; silent
ok 'threads do not matter' cmp a.png b.png

# Names: in the folder that BRACE_MODELS names, brace-s by default. Merge where it is not.
mkdir models
cp net.safetensors models/brace-s.safetensors
BRACE_MODELS=models run 0 restore small -o c.png --json; cp out r.json
is default "$(json r.json method)" brace
is where "$(json r.json network weights)" models/brace-s.safetensors
ok 'the same picture' cmp a.png c.png
BRACE_MODELS=models run 0 restore small -qo d.png --model brace-s; ok 'by name' cmp a.png d.png
BRACE_MODELS=models run 1 restore small -o x.png --model tmrnet-s; says 'no weights of this name (tmrnet-s.safetensors)'
absent x.png
run 0 restore small -o m.png --json; cp out r.json; is merged "$(json r.json method)" merge
is 'no remark' "$(json r.json notes count)" 0
is network "$(json r.json network)" null
run 0 restore small -o m.png --method brace --json; cp out r.json; is merged "$(json r.json method)" merge
says "merged instead: no network's weights are installed"; is remark "$(json r.json notes count)" 1
run 1 restore small -o x.png --model brace-s; says 'brace-s.safetensors'; absent x.png

# Those that ship.
BRACE_MODELS=$root/models run 0 restore small -o s.png --json; cp out r.json
is 'shipped weights' "$(json r.json network weights)" "$root/models/brace-s.safetensors"
is 'no remark' "$(json r.json notes count)" 0
ok 'a picture of their own' bash -c '! cmp -s a.png s.png'
ok 'near the merged one' "$helper" same m.png s.png 28
if [ -z "${BRACE_TEST_KILLS:-}" ]; then # a sanitizer would take its time, and says nothing of how good they are
    BRACE_DATA=$root/data run 0 dataset build -o set --train 1 --test 4 --size 256x192 --seed 13 -q
    run 0 eval --data set --method "merge,net=$root/models/brace-s.safetensors" --json -q; cp out e.json
    psnr() { json e.json groups 0 methods "$1" psnr mean; }
    ok "$(psnr net) dB, more than 0.5 above merging's $(psnr merge)" awk -v a="$(psnr net)" -v b="$(psnr merge)" \
        'BEGIN { exit !(a > b + 0.5) }'
fi

# Brackets that it has not learned are merged.
run 0 restore small/frame_[234].dng -o m.png --model net.safetensors --json; cp out r.json
says 'merged instead: brace-s takes brackets of 5 frames, and this one has 3'; is merged "$(json r.json method)" merge
run 0 restore small -o m.png --exposures 1,10,20,40,80 --model net.safetensors; says 'about four times the one before'
run 0 restore small -o m.png -r 2 --model net.safetensors; says 'middle exposure'

# Memory, precision.
run 0 restore small -qo e.png --model net.safetensors --precision f32 --memory 50
ok 'f32' "$helper" same a.png e.png 1
run 0 restore small -qo f.png --model net.safetensors --precision bf16
ok 'bf16' "$helper" same a.png f.png 1
run 1 restore small -o x.png --model net.safetensors --memory 1; says 'may use 1 MB'; says '--memory'; absent x.png
run 2 restore small -o x.png --precision f16; says "f32 or bf16, not 'f16'"
run 2 restore small -o x.png --memory 0; says '1 to'
run 2 restore small -o x.png --method merge --model net.safetensors; says '--model is for networks'
run 2 restore small -o x.png --method merge --memory 100; says '--memory is for networks'
run 2 restore small -o x.png --method net.safetensors; says '--model'

# The report tells of it.
run 0 restore small -q --model net.safetensors --report r.html; alone r.html
ok 'the model' grep -q '<bdi>brace-s</bdi><small>BRACE' r.html
ok 'its file' grep -q 'net.safetensors' r.html
ok 'no weights of frames' bash -c '! grep -qi "nan" <(sed "s/base64,[^\"]*//g" r.html)'

# Files that are none: a sentence, and nothing written.
head -c 3000 net.safetensors >cut.safetensors
run 1 restore small -o x.png --model cut.safetensors; says cut.safetensors
: >empty.safetensors
run 1 restore small -o x.png --model empty.safetensors; says empty.safetensors
run 1 restore small -o x.png --model small/frame_1.dng; says frame_1.dng
run 1 restore small -o x.png --model missing.safetensors; says missing.safetensors
run 1 restore small -o x.png --model models/; says models/
run 1 restore small -o x.png --model ''; says 'is empty'
"$helper" network nan.safetensors brace-s nan
run 1 restore small -o x.png --model nan.safetensors; says 'a number that is none'
cp nan.safetensors models/brace-s.safetensors
BRACE_MODELS=models run 1 restore small -o x.png; says 'a number that is none'
for seed in 1 2 3 4 5 6; do
    "$helper" damage net.safetensors damaged.safetensors $seed
    "$brace" restore small -qo y.png --model damaged.safetensors 2>err
    code=$?
    ok "damage $seed is met" test $code -le 1
    [ $code -eq 0 ] || ok "damage $seed is told" test -s err
done
absent x.png
is 'left behind' "$(find . -name '*.part*' -o -name '.*tmp*' | wc -l)" 0
finish
