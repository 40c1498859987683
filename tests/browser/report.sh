#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Opens reports in headless Chromium and uses them. Skipped where Chromium or node is not installed (make check-slow
# installs them and insists). BRACE_SHOTS=FOLDER keeps screenshots.
here=$(cd "$(dirname "$0")" && pwd)
chromium=
for program in chromium chromium-browser google-chrome; do
    [ -n "$chromium" ] || chromium=$(command -v "$program")
done
if [ -z "$chromium" ] || ! command -v node >/dev/null; then
    echo 'chromium or node is not installed'
    [ -z "${BRACE_NEED_BROWSER:-}" ] && exit 77
    exit 1
fi
shots=${BRACE_SHOTS:+$(realpath "$BRACE_SHOTS")}
source "$here/../cli/lib.sh"
unset BRACE_WEIGHTS

# A bracket with a truth and names that try to be code.
make_small small 100,100,320,240
"$brace" restore small/frame_*.dng -q -o truth.png || exit 1
"$helper" edit small/frame_1.dng 'small/<img src=x onerror="hacked=1">.dng' 'model=<script>hacked=2</script>' || exit 1
rm small/frame_1.dng
for i in 2 3 4 5; do
    "$helper" edit small/frame_$i.dng edited.dng 'model=<script>hacked=2</script>' && mv edited.dng small/frame_$i.dng || exit 1
done
run 0 restore small --report restore.html --truth truth.png -q
mkdir pred gt
"$brace" restore small -q -m reference -o pred/b.png -o pred/a2.jpg || exit 1
cp truth.png 'pred/<b onclick="hacked=3">.png'
for name in b a2 '<b onclick="hacked=3">' a10; do cp truth.png "gt/$name.png"; done
"$helper" white pred/a10.png 64 || exit 1
run 1 metrics pred gt --html metrics.html -q -m psnr,ssim
exists restore.html
exists metrics.html
[ "$failures" -eq 0 ] || finish
node "$here/report.js" "$chromium" restore.html metrics.html $shots
