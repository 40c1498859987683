#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# brace eval: a small set, its tables, files, report and sheet, and what can be wrong.
source "$(dirname "$0")/lib.sh"
unset BRACE_WEIGHTS
"$helper" network net.safetensors tmrnet-s || exit 1
"$brace" dataset build -o set --train 1 --test 3 --size 128x96 --seed 3 -q || exit 1

run 0 eval --data set --method reference,merge,net.safetensors --csv e.csv --html e.html --sheet e.png -q
prints 'PSNR'; prints 'MS-SWD'; prints 'SFC in parts'; prints 'family'; prints 'category'; prints 'worse'
is 'methods in a group' "$(sed -n '/^banded/,/^[a-z]/p' out | grep -c '^  ')" 3
is 'rows' "$(wc -l <e.csv)" 10
is 'columns' "$(head -1 e.csv | tr -d '\r' | cut -d, -f1-9)" sample,family,category,flicker_free,method,psnr,ssim,ms-swd,sfc
ok 'only the test split' bash -c '! grep -q train/ e.csv'
alone e.html
ok 'samples can be picked' grep -q 'data-pair="0"' e.html
ok 'the network has its pictures' grep -q 'data-label="net"' e.html
is 'pictures a sample' "$(grep -c 'data-label="Truth"' e.html)" 4
is 'the sheet' "$("$helper" size e.png)" "$((6 + 4 * 366)) $((6 + 3 * 276)) 3 8"

# JSON has the same numbers; the means are those of the samples.
run 0 eval --data set --method reference,mine=net.safetensors --json -q -t 1; cp out e.json
is label "$(json e.json methods 1 label)" mine
is model "$(json e.json methods 1 model)" net.safetensors
is samples "$(json e.json samples count)" 3
is 'the reference is itself' "$(json e.json samples 0 methods reference psnr)" "$(json e.json samples 0 reference_psnr)"
is 'none is worse than itself' "$(json e.json groups 0 methods reference worse)" 0
mean=$(awk -F, '$5 == "reference" && $4 == 0 { s += $6 > 100 ? 100 : $6; n++ } END { printf "%.3f", s / n }' e.csv)
is 'the mean' "$(printf '%.3f' "$(json e.json groups 0 methods reference psnr mean)")" "$mean"
run 0 eval --data set --method reference,mine=net.safetensors --json -q -t 2
is 'threads change nothing' "$(sed 's/"seconds":.*//' out | cmp - <(sed 's/"seconds":.*//' e.json) && echo same)" same

# A method that fails everywhere has no numbers, rather than perfect ones.
run 1 eval --data set --method reference,net.safetensors --memory 1 --html none.html -q; alone none.html
ok 'the net has rows' grep -qE '^  net ' out
is 'rows of the net without a number' "$(grep -cE '^  net( +-)+$' out)" "$(grep -cE '^  net ' out)"
ok 'no parts' grep -q '>net</bdi></th><td data-v=""><span class="none">–</span></td><td data-v=""><span class="none">–</span></td><td data-v=""><span class="none">–</span></td><td data-v=""><span class="none">–</span></td></tr>' none.html
run 1 eval --data set --method reference,net.safetensors --memory 1 --json -q
is 'parts in JSON' "$("$helper" json out groups 0 methods net sfc_parts d_ratio mean 2>/dev/null)" null

# What `brace metrics` measures of the same picture.
sample=$(ls -d set/test/* | head -1)
"$brace" restore "$sample"/frame_*.dng -q --method merge -o m.dng || exit 1
"$brace" metrics m.dng "$sample/gt.dng" -b "$sample"/frame_1.dng -m psnr,sfc,ms-swd --json -q >m.json || exit 1
run 0 eval --data "$sample" --method merge --json -q; cp out e.json
for m in psnr sfc ms-swd; do
    is "$m as brace metrics" "$(json e.json samples 0 methods merge $m)" "$(json m.json pairs 0 metrics $m)"
done

# Folders that BRACE did not make: no meta.json; a control; a part of the set; scenes by name.
mkdir -p alien/one alien/two alien/2 alien/flicker_free
cp "$sample"/*.dng alien/one; cp "$sample"/*.dng alien/two
cp "$sample"/*.dng alien/2; cp "$sample"/*.dng alien/flicker_free
echo '{"flicker_free": true, "display": {"family": "<b>&\"x,y"}}' >alien/two/meta.json
run 0 eval --data alien --method reference --html x.html --csv x.csv --scenes two; prints 'family unknown (1)'; prints 'family one (1)'; prints 'flicker-free (2)'
alone x.html
ok 'only this scene has pictures' bash -c '! grep -q "data-pair=\"0\"" x.html'
run 0 eval --data set --count 1 --method reference -q; ok 'one sample' grep -q '(1)' out
run 1 eval --data set --method reference --scenes nosuch --sheet y.png; says nosuch; absent y.png

# A sample that is damaged is said, and the others are measured.
rm -r alien/2 alien/flicker_free alien/one/gt.dng
run 1 eval --data alien --method reference; says 'one: gt.dng is missing'; prints 'flicker-free (1)'
rm alien/two/frame_3.dng
run 1 eval --data alien --method reference; says 'none of the samples could be measured'

# Usage.
run 2 eval; says '--data'
run 2 eval set; says 'named with --data'
run 2 eval --data set --method reference,; says 'empty name'
run 2 eval --data set --method merge,merge; says 'twice'
run 1 eval --data set --method nosuch; says 'nosuch.safetensors'
run 1 eval --data set --method missing.safetensors; says missing.safetensors
run 1 eval --data nowhere; says nowhere
run 2 eval --data set --sheet x.jpg; says '.png'
run 1 eval --data set --csv nowhere/x.csv; says nowhere
run 2 eval --data set --csv x --html ./x; says 'given twice'
run 2 eval --data set --scenes 1; says '--sheet'
run 0 eval --help; prints 'Examples'; prints '--sheet'
run 0 help eval; prints '--method'

# Stopped in the middle: no file.
for i in {10..40}; do cp -r "$sample" "set/test/0000${i}_UI"; done
is 'stopped' "$("$helper" stop 150 INT "$brace" eval --data set --csv s.csv -q 2>err)" 130
absent s.csv
finish
