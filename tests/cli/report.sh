#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Reports: one file that needs no other, names that try to be markup, and what can go wrong with writing it.
source "$(dirname "$0")/lib.sh"
unset BRACE_WEIGHTS
make_small

pictures() {
    grep -o '<img ' "$1" | wc -l
}

# ---- restore ----
run 0 restore small --report r.html -o r.png --json; cp out r.json
alone r.html
says 'wrote r.html'
is outputs "$(json r.json outputs count)" 2
is format "$(json r.json outputs 1 format)" HTML
is pictures "$(pictures r.html)" 9
ok 'PNG for plots' grep -q 'data:image/png' r.html
ok reference grep -q '>reference<' r.html
ok method grep -q 'merge<small>BRACE' r.html
run 0 restore small --report only.html -q; silent; exists only.html
run 0 restore small --report small.html --report-side 64 -q
is 'the longest side' "$(grep -oE '<img width="[0-9]+" height="[0-9]+" alt="The restored' small.html)" '<img width="64" height="51" alt="The restored'
ok 'the limit is said' grep -q 'at most 64 pixels' small.html

# With the truth: a perfect one gives infinity.
"$brace" restore small -q -o t.dng -o t.tif --bits 16 || exit 1
run 0 restore small --report t.html --truth t.tif -q; alone t.html
ok 'infinite PSNR' grep -q '∞' t.html
is 'pictures with the truth' "$(pictures t.html)" 10
run 0 restore small --report t2.html --truth t.dng -q; ok 'RAW truth' grep -q '<th scope="row">SFC' t2.html
make_small other 200,160,128,128
run 1 restore small --report x.html --truth other/frame_3.dng -q; says '128 x 128'; absent x.html
run 1 restore small --report x.html --truth nothing.png -q; says nothing.png; absent x.html
run 2 restore small -o x.png --truth t.tif; says '--report'
run 2 restore small --report x.html --truth t.tif --exposure 1; says '--exposure'
run 2 restore small --report x.html --report-side 10; says 64
run 2 restore small -o x.png --report-side 100; says '--report'

# Where it goes.
run 2 restore small -o a.png --report ./a.png; says 'given twice'
run 2 restore small --report small/frame_1.dng; says 'one of the inputs'
run 2 restore --report other/frame_1.dng small/frame_*.dng -o x.png; says '.html' # the name was forgotten
run 2 restore small -o t.tif --report x.html --truth t.tif; says 'one of the inputs'
cp t.dng small/steady.dng # a truth beside the frames
run 0 restore small --report t3.html --truth small/steady.dng -q --json; is frames "$(json out inputs count)" 5
run 2 restore small -o small/frame_3.dng; says 'one of the inputs'
rm small/steady.dng
for i in 1 2; do run 0 restore small -q -o small/result.dng; done # a result of before may be replaced
rm small/result.dng
run 1 restore small --report nowhere/r.html; says nowhere
run 2 restore small --report small; says 'is a folder'
run 2 restore small --report /dev/stdout --json; says 'standard output'
if [ -e /dev/full ]; then
    run 1 restore small -q -o kept.png --report /dev/full; says '/dev/full'; says 'o space left'; says 'kept.png was already'
    run 2 metrics r.png kept.png -q -m psnr --csv kept.png; says 'one of the inputs'
    run 1 metrics r.png kept.png -q -m psnr --html /dev/full; says 'o space left'; prints PSNR
fi
echo old >keep.html
(ulimit -f 16; trap '' XFSZ; "$brace" restore small -q --report keep.html) >out 2>err
is 'file size limit' $? 1
is 'the old report' "$(cat keep.html)" old
is 'leftovers' "$(find . -name '.brace*' | wc -l)" 0
if [ "$(id -u)" -ne 0 ]; then
    mkdir shut && chmod 555 shut
    run 1 restore small --report shut/r.html; says shut
fi

# Names that try to be markup: files, camera, bytes that are no UTF-8, letters that turn the direction.
mkdir evil
i=0
for name in '<img src=x onerror=alert(1)>' "'\"><script>alert(2)</script>" $'\xff\xc0\xaf\xed\xa0\x80 bytes' $'\xe2\x80\xaegnp.exe' '&lt;b&gt; {{body}}'; do
    i=$((i + 1))
    "$helper" edit "small/frame_$i.dng" "evil/$(tr / _ <<<"$name").dng" 'model=</title><script>m()</script>' || exit 1
done
run 0 restore evil --report '"evil".html' -q
alone '"evil".html'
ok 'the name as text' grep -qF '&lt;img src=x onerror=alert(1)&gt;.dng' '"evil".html'
ok 'the camera as text' grep -qF '&lt;/title&gt;&lt;script&gt;m()' '"evil".html'
ok 'an ampersand' grep -qF '&amp;lt;b&amp;gt; {{body}}' '"evil".html'
ok 'bytes that are no text' grep -qF '������ bytes' '"evil".html'
is 'letters that turn' "$(grep -cP '\xe2\x80\xae' '"evil".html')" 0
is elements "$(grep -oE '<(script|title)' '"evil".html' | wc -l)" 2

# ---- metrics ----
mkdir pred gt
"$brace" restore small -q -m reference -o pred/b.jpg || exit 1
cp r.png pred/a.png; cp r.png gt/a.png; cp t.tif gt/b.tif
cp r.png "pred/<script>'c'.png"; cp t.tif "gt/<script>'c'.tif"; cp r.png gt/alone.png
run 0 metrics pred gt --html m.html --csv m.csv --json -q; alone m.html
is rows "$(grep -c '<tr data-pair=' m.html)" 3
is templates "$(grep -o '<template id="pair-' m.html | wc -l)" 3
is 'pictures of pairs' "$(pictures m.html)" 8
ok 'a hostile name' grep -qF '&lt;script&gt;&#39;c&#39;' m.html
ok 'infinite' grep -qF 'data-v="Infinity"' m.html
ok unmatched grep -qF 'gt/alone.png' m.html
is json "$(json out pairs count)" 3
# The worst pair is shown first.
is worst "$(grep -oE '<tr data-pair="[0-9]+" class="shown">' m.html)" '<tr data-pair="2" class="shown">'
run 0 metrics pred/b.jpg t.tif --html one.html -q; alone one.html
ok 'spectra of one pair' grep -q 'Power spectrum, Prediction' one.html
is 'no table to pick from' "$(grep -c '<tr data-pair' one.html)" 0
# A pair that fails is in the table without numbers and pictures.
cp other/frame_1.dng gt/b.dng; rm gt/b.tif
run 1 metrics pred gt --html m2.html -q; alone m2.html
is 'pairs with pictures' "$(grep -c '<tr data-pair=' m2.html)" 2
ok 'not measured' grep -qF 'data-v=""' m2.html
run 2 metrics r.png t.tif --html ./r.png; says 'one of the inputs'
run 2 metrics r.png t.tif --html x.html --csv x.html; says 'given twice'
run 1 metrics r.png t.tif --html nowhere/x.html; says nowhere
run 2 metrics r.png t.tif --html-side 100; says --html
run 2 metrics r.png t.tif --html /dev/stdout; says 'standard output'
finish
