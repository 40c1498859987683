#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Restoring into every format, the summary, the JSON object, and the options
# that change the result.
source "$(dirname "$0")/lib.sh"
make_small

run 0 restore small/frame_*.dng -o a.dng -o a.png -o a.tif -o a.jpg -o a.webp -o b.jpeg -o b.tiff
says 'reference'; says '1/1600 s'; says 'wrote a.webp'; says 'frame_5.dng'; says '+4.00'
is 'stdout' "$(cat out)" ''
is 'PNG' "$("$helper" size a.png)" '160 128 3 8'
is 'TIFF' "$("$helper" size a.tif)" '160 128 3 16'
is 'JPEG' "$("$helper" size a.jpg)" '160 128 3 8'
is 'WebP' "$("$helper" size a.webp)" '160 128 3 8'
ok 'PNG and TIFF agree' "$helper" same a.png a.tif 0.6
ok 'PNG and JPEG agree' "$helper" same a.png a.jpg 4
ok 'PNG and WebP agree' "$helper" same a.png a.webp 4
ok 'both JPEG names' cmp a.jpg b.jpeg
run 0 info a.dng; prints '160 x 128'; prints '1/1600 s'; prints 'Median phone'

run 0 restore small/ -q -o deep.png --bits 16; is '16-bit PNG' "$("$helper" size deep.png)" '160 128 3 16'
run 0 restore small/ -q -o float.tif --bits 32; is 'float TIFF' "$("$helper" size float.tif)" '160 128 3 32'
ok 'float is the same picture' "$helper" same float.tif a.png 0.6
run 0 restore small/ -q -o both.tif -o both.jpg --bits 32
is 'JPEG beside a float TIFF' "$("$helper" size both.jpg)" '160 128 3 8'
ok 'and the same' "$helper" same both.jpg a.jpg 1
run 0 restore small/ -q -o low.jpg --quality 20
ok 'quality makes a smaller file' test "$(stat -c %s low.jpg)" -lt "$(stat -c %s a.jpg)"
run 0 restore small/ -q -o bright.png --exposure 1
checks=$((checks + 1)); "$helper" same bright.png a.png 3 >/dev/null && bad '--exposure changes nothing'

# The result does not depend on order, threads, or how often it is run.
run 0 restore small/frame_5.dng small/frame_2.dng small/frame_1.dng small/frame_4.dng small/frame_3.dng -q -o order.png
ok 'any order' cmp order.png a.png
run 0 restore small -q -o one.png --threads 1; ok 'one thread' cmp one.png a.png
run 0 restore small -q -o five.png -t5; ok 'five threads' cmp five.png a.png
run 0 restore small -q -o five.png -t5; ok 'over an old file' cmp five.png a.png

# A folder: its RAW files, without the output that lies among them.
run 0 restore small -q -o small/result.dng; exists small/result.dng
run 0 restore small -q -o small/result.dng
ok 'twice the same' cmp small/result.dng a.dng; rm small/result.dng
leaves small frame_1.dng frame_2.dng frame_3.dng frame_4.dng frame_5.dng

# Reference and method.
run 0 restore small/frame_*.dng --method reference -o ref.dng -o ref.png; says 'reference, '
run 0 restore small/frame_*.dng --method reference -q -o ref2.png --reference 3; ok 'reference 3' cmp ref.png ref2.png
run 0 restore small/frame_*.dng --method reference -q -o ref4.dng --reference frame_4.dng
run 0 info ref4.dng; prints '1/400 s'
run 0 restore small/frame_*.dng -m reference -q -o ref4b.dng -r ./small/frame_4.dng; ok 'by path' cmp ref4.dng ref4b.dng
run 0 restore small/frame_*.dng --no-align -q -o still.png; exists still.png

# JSON.
run 0 restore small/frame_*.dng -o j.png -o j.dng --json --quiet
is 'stderr' "$(cat err)" ''
cp out j.json
is version "$(json j.json version)" "$VERSION"
is method "$(json j.json method)" merge
is reference "$(json j.json reference)" small/frame_3.dng
is inputs "$(json j.json inputs count)" 5
is outputs "$(json j.json outputs 1 path)" j.dng
is format "$(json j.json outputs 0 format)" PNG
is ev "$(json j.json inputs 4 ev)" 4
is relative "$(json j.json inputs 0 relative_exposure)" 0.0625
is time "$(json j.json inputs 2 exposure_time)" 0.000625
for key in dx dy rotation scale local confidence; do
    ok "motion $key" json j.json inputs 0 motion $key
done
for key in weight banding measured iso f_number; do
    ok "$key" json j.json inputs 1 $key
done
for key in read align light fuse develop write total; do
    ok "seconds $key" json j.json seconds $key
done
run 1 restore small/frame_*.dng -o j.png --json --exposures 1,1,1,1,1; cp out e.json
ok 'an error is an object too' json e.json error message

# Names that don't tell: pipes.
"$brace" restore small -q -o /dev/stdout --format png >pipe.png; ok '/dev/stdout, redirected' cmp pipe.png a.png
"$brace" restore small -q -o /dev/stdout --format png | cat >pipe.png; ok '/dev/stdout, piped' cmp pipe.png a.png
"$brace" restore small -q -o /dev/stdout --format dng | cat >pipe.dng; ok 'a DNG through a pipe' cmp pipe.dng a.dng
"$brace" restore small -q -o /dev/stdout --format tif | cat >pipe.tif; ok 'a TIFF through a pipe' cmp pipe.tif a.tif
printf before >both.bin
"$brace" restore small -q -o /dev/stdout --format png >>both.bin
ok '/dev/stdout, appended' cmp <(printf before; cat a.png) both.bin
{ printf head; "$brace" restore small -q -o /dev/stdout --format png; printf tail; } >both.bin
ok '/dev/stdout, between others' cmp <(printf head; cat a.png; printf tail) both.bin; rm both.bin
run 2 restore small -o /dev/stdout --format png --json; says "can't both"

# Even numbers of frames, two orientations, three frames, nine frames.
run 0 restore small/frame_[1-4].dng -q -o four.dng; run 0 info four.dng; prints '1/6400 s'
run 0 restore small/frame_[234].dng -q -o three.png; exists three.png
for i in 1 2 3 4; do "$helper" edit small/frame_$i.dng small/extra_$i.dng orientation=1; done
run 0 restore small -q -o nine.png; exists nine.png
mkdir turned
for i in 1 2 3 4 5; do "$helper" edit small/frame_$i.dng turned/$i.dng orientation=6; done
run 0 restore turned -q -o turned.png -o turned.dng
is 'turned upright' "$("$helper" size turned.png)" '128 160 3 8'
run 0 info turned.dng; prints '160 x 128'; prints '90 degrees clockwise'

# All CFA orders, from crops at odd origins.
for origin in 200,160 201,160 200,161 201,161; do
    rm -rf cfa; make_small cfa "$origin,159,127"
    run 0 restore cfa -q -o "cfa-$origin.png"
    is 'odd size' "$("$helper" size "cfa-$origin.png")" '159 127 3 8'
done
leaves . a.dng a.png a.tif a.jpg a.webp b.jpeg b.tiff deep.png float.tif both.tif both.jpg low.jpg bright.png order.png \
    one.png five.png ref.dng ref.png ref2.png ref4.dng ref4b.dng still.png j.png j.dng j.json e.json pipe.png pipe.dng \
    pipe.tif four.dng three.png nine.png turned turned.png turned.dng cfa cfa-200,160.png cfa-201,160.png \
    cfa-200,161.png cfa-201,161.png small out err
finish
