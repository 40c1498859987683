#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# brace dataset: usage, and a set of two samples packed, verified, damaged, looked at; captures imported.
source "$(dirname "$0")/lib.sh"

run 2 dataset; says 'which action?'
run 2 dataset verifi; says "did you mean 'verify'?"
run 0 dataset --help; prints 'import'
run 0 help dataset; prints 'import'
for action in pack verify info import; do
    run 0 dataset $action --help; prints "Usage: brace dataset $action"
    run 2 dataset $action; says 'which folder'
done
run 2 dataset pack here; says 'where to?'
run 2 dataset pack a b -o c; says 'one folder at a time'
run 1 dataset verify nowhere; says 'nowhere'; says 'does not exist'
run 1 dataset info nowhere; says 'nowhere'
mkdir empty
run 1 dataset verify empty; says 'no samples'
run 1 dataset import empty -o real; says 'no captures'

# Built from a seed: whole, in shards, resumed.
export BRACE_DATA="$root/data"
run 2 dataset build; says 'where to?'
run 2 dataset build -o b --size 10; says '1024x768'
run 2 dataset build -o b --shard 3/2; says '3/2'
run 2 dataset build -o b --seed -1; says 'seed'
run 1 dataset build -o b --size 33x32 --train 1 --test 1; says 'even'
run 1 dataset build -o b --screens empty --train 1 --test 1; says 'no pictures'
printf '{"displays": {"crt_60": 1},\n "flicker_free": 7}' >p.json
run 1 dataset build -o b --priors p.json; says 'p.json:2'; says 'flicker_free'
absent b
build=(--train 5 --test 2 --size 96x64 --seed 7 --quiet)
run 0 dataset build -o whole "${build[@]}" -t 2; silent
run 0 dataset verify whole; prints '7 samples, 0 bad, 0 missing'
run 0 dataset build -o parts "${build[@]}" -t 1 --shard 2/2
run 1 dataset verify parts; prints 'is missing'
OMPI_COMM_WORLD_RANK=0 OMPI_COMM_WORLD_SIZE=2 run 0 dataset build -o parts "${build[@]}"
ok 'a set made in shards is the same' diff -r whole parts
mv whole/train/000002_* whole/train/.part-000002_x; rm -r whole/train/000003_*
run 0 dataset build -o whole --json "${build[@]}"; cp out i.json
is made "$(json i.json made)" 2; is there "$(json i.json there_already)" 5
rm -r whole/train/.part-000002_x
ok 'a set made in two goes is the same' diff -r whole parts
run 1 dataset build -o whole "${build[@]}" --field; says "'field' differs"
run 0 restore whole/train/000000_*/frame_*.dng -o restored.png --quiet
# Stopped: whole samples only.
code=$("$helper" stop stopped/train+2000 TERM "$brace" dataset build -o stopped --train 20000 --test 1 --size 128x96 --quiet 2>/dev/null)
is 'exit code after SIGTERM' "$code" 143
is 'unfinished samples' "$(find stopped -name '.part-*')" ''
run 1 dataset verify stopped; prints ' 0 bad, '

make_small set/train/000000_web
make_small set/test/000003_UI
for s in set/train/000000_web set/test/000003_UI; do cp $s/frame_3.dng $s/gt.dng; done
run 0 dataset verify set; prints '2 samples, 0 bad, 0 missing, 2 without hashes'
run 0 dataset verify set --quiet; silent
run 0 dataset info set; prints '2 samples'; prints 'web'; prints 'train'
run 0 dataset info set --json; cp out i.json; is samples "$(json i.json samples)" 2
is web "$(json i.json categories web)" 1

run 0 dataset pack set -o shards --quiet; silent
leaves shards guides.safetensors motions.safetensors test-00000.safetensors train-00000.safetensors
ok 'motions and guides are no samples' test -s shards/guides.safetensors
run 0 dataset pack set -o again --json; cp out i.json; is shards "$(json i.json shards)" 2
ok 'the same samples give the same bytes' cmp shards/train-00000.safetensors again/train-00000.safetensors
run 0 dataset verify shards; prints '2 samples, 0 bad'
"$helper" damage shards/test-00000.safetensors again/test-00000.safetensors 7
run 1 dataset verify again
run 1 dataset verify again --json; cp out i.json; is 'bad samples' "$(json i.json bad)" 1

# A full disk leaves no shard.
(ulimit -f 4; trap '' XFSZ; "$brace" dataset pack set -o full) >out 2>err; is 'exit code on a full disk' $? 1
last='dataset pack onto a full disk'; says 'cannot write'; is 'left on it' "$(find full -type f | wc -l)" 0

echo '{"samples": ["train/000000_web", "train/000009_web", "test/000003_UI"]}' >set/dataset.json
run 1 dataset verify set; prints 'train/000009_web: it is missing'
"$helper" edit set/train/000000_web/frame_4.dng flat.dng flat=200
cp flat.dng set/train/000000_web/frame_4.dng
run 1 dataset verify set; prints 'train/000000_web: frame_4.dng: all pixels have the value 200'
rm set/test/000003_UI/frame_2.dng
run 1 dataset verify set; prints 'test/000003_UI: frame_2.dng is missing'
run 1 dataset pack set -o shards; says 'test/000003_UI: frame_2.dng is missing'

# A capture as the protocol has it, and one without its truth.
for c in good flat; do
    mkdir -p card/$c
    for i in 1 2 3 4 5; do cp "$root/data/demo/frame_$i.dng" card/$c/; done
done
time=$("$brace" info --json "$root/data/demo/frame_3.dng" | "$helper" json /dev/stdin frames 0 exposure_time)
iso=$("$brace" info --json "$root/data/demo/frame_3.dng" | "$helper" json /dev/stdin frames 0 iso)
"$helper" edit "$root/data/demo/frame_3.dng" card/good/a.dng time="$(awk "BEGIN{print 8*$time}")" iso="$(awk "BEGIN{print $iso/8}")"
cp card/flat/frame_3.dng card/flat/a.dng
run 0 dataset import card -o real --reduce 2
prints 'card/good: taken'; prints 'card/flat: rejected: no file has a much lower ISO'; prints '1 taken, 1 rejected'
leaves real good
leaves real/good frame_1.dng frame_2.dng frame_3.dng frame_4.dng frame_5.dng gt.dng meta.json
run 0 dataset verify real; prints '1 samples, 0 bad, 0 missing'
run 0 restore real/good/frame_*.dng -o restored.dng --quiet
run 0 dataset import card -o real --reduce 2 --json; cp out i.json; is there "$(json i.json there_already)" 1
printf 'x' >>real/good/gt.dng
run 1 dataset verify real; prints 'good: gt.dng has'
finish
