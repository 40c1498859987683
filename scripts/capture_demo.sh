#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Plans a bracket, shoots it with a simulated camera that makes mistakes, checks
# the folder and restores it: from the shutter to a picture.
# Usage: scripts/capture_demo.sh BRACE [OUTPUT FOLDER]
set -euo pipefail
brace=${1:-build/release/src/cli/brace}
out=${2:-demo/capture}
side_by_side=$(dirname "$brace")/../../bench/side_by_side
camera=(--camera sim --option display=led_wall_3840_16 --option time=1/1600 --option level=0.25
    --option seed=5 --option size=768x576)

mkdir -p "$out"
rm -rf "$out/sequence" "$out/.capture-sequence"
echo '== The plan: an LED wall of 3840 Hz'
"$brace" capture plan "${camera[@]}" --time 1/1600 --flicker 3840
echo
echo '== Shooting; the camera is busy, loses a frame, hands one in twice and forgets to set its shutter'
"$brace" capture run -o "$out/sequence" "${camera[@]}" --time 1/1600 --fault busy:2,drop:4,same:6,shutter:9
echo
echo '== What came of it'
"$brace" capture check --quiet "$out/sequence"
"$brace" restore "$out/sequence" -o "$out/restored.dng" -o "$out/restored.png" --exposure 2.5
"$brace" restore "$out/sequence" --method reference -o "$out/reference.png" --exposure 2.5 --quiet
pictures=(sequence/ restored.dng restored.png reference.png)
if [ -x "$side_by_side" ]; then
    "$side_by_side" "$out/reference.png" "$out/restored.png" "$out/before_after.png"
    pictures+=(before_after.png)
fi
out=$(cd "$out" && pwd)
echo
echo 'The files:'
printf "  $out/%s\n" "${pictures[@]}"
