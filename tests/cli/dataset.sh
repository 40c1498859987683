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

make_small set/train/000000_web
make_small set/test/000003_UI
for s in set/train/000000_web set/test/000003_UI; do cp $s/frame_3.dng $s/gt.dng; done
run 0 dataset verify set; prints '2 samples, 0 bad, 0 missing, 2 without hashes'
run 0 dataset verify set --quiet; silent
run 0 dataset info set; prints '2 samples'; prints 'web'; prints 'train'
run 0 dataset info set --json; cp out i.json; is samples "$(json i.json samples)" 2
is web "$(json i.json categories web)" 1

run 0 dataset pack set -o shards --quiet; silent
leaves shards test-00000.safetensors train-00000.safetensors
run 0 dataset pack set -o again --json; cp out i.json; is shards "$(json i.json shards)" 2
ok 'the same samples give the same bytes' cmp shards/train-00000.safetensors again/train-00000.safetensors
run 0 dataset verify shards; prints '2 samples, 0 bad'
"$helper" damage shards/test-00000.safetensors again/test-00000.safetensors 7
run 1 dataset verify again
run 1 dataset verify again --json; cp out i.json; is 'bad samples' "$(json i.json bad)" 1

# A full disk leaves no shard.
if [ -w /dev/full ]; then run 1 dataset pack set -o /dev/full; fi

echo '{"samples": ["train/000000_web", "train/000009_web", "test/000003_UI"]}' >set/dataset.json
run 1 dataset verify set; prints 'train/000009_web: it is missing'
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
