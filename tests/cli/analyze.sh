#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# brace analyze: a known backlight is found and its frequency told, steady light is not taken for banding; JSON, plot,
# wrong usage.
source "$(dirname "$0")/lib.sh"
export BRACE_DATA=$root/data

cat >backlight.json <<'END'
{"family": "monitor", "driver": "lcd_pwm", "frequency": 1000, "duty": 0.4}
END
run 0 simulate "$root/data/screens/000012_web.webp" -o banded --display ./backlight.json --camera phone_median \
    --size 512x640 --time 1/800 --level 0.7 --iso 100 --seed 3
run 0 simulate "$root/data/screens/000012_web.webp" -o steady --display steady --camera phone_median \
    --size 512x640 --time 1/800 --level 0.7 --iso 100 --seed 3
banded=banded/000000 steady=steady/000000

run 0 analyze "$banded"/frame_*.dng --camera phone_median; prints 'Hz'; prints 'shutter times free of banding'
prints 'backlight'; prints '1/100 s'
run 0 analyze "$banded" --readout 14.5 --json; cp out a.json
is frames "$(json a.json frames count)" 6 # the folder holds the truth as well
run 0 analyze "$banded"/frame_*.dng --readout 14.5 --json -q; cp out a.json
is frames "$(json a.json frames count)" 5
is source "$(json a.json source)" backlight
ok 'near 1000 Hz' awk "BEGIN {exit !($(json a.json hz) > 990 && $(json a.json hz) < 1010)}"
ok 'sure' awk "BEGIN {exit !($(json a.json confidence) > 0.9)}"
ok 'sure of the frequency' awk "BEGIN {exit !($(json a.json frequency_confidence) > 0.5)}"
ok 'along the rows' awk "BEGIN {x = $(json a.json frames 0 orientation); exit !(x < 1 || x > 179)}"
ok 'deep in the shortest' awk "BEGIN {exit !($(json a.json frames 0 contrast) > 0.8)}"
is descriptor "$(json a.json frames 0 fabp descriptor count)" 8
is harmonics "$(json a.json frames 0 harmonics count)" 6
is usual "$(json a.json usual_shutters count)" 34
run 0 analyze "$banded"/frame_*.dng --json; cp out b.json
is hz "$(json b.json hz)" null; is usual "$(json b.json usual_shutters count)" 0

run 0 analyze "$steady"/frame_*.dng --readout 14.5; prints 'no banding found'
run 0 analyze "$steady"/frame_*.dng --readout 14.5 --json; cp out c.json; is source "$(json c.json source)" steady
run 0 analyze "$banded/frame_1.dng"; prints 'frame_1.dng'

run 0 analyze "$banded"/frame_*.dng --readout 14.5 --plot plot.png -q
ok 'a plot' test -s plot.png
run 0 analyze "$banded/frame_2.dng" --plot single.jpg -q; ok 'a plot of one' test -s single.jpg
run 1 analyze "$banded/frame_2.dng" --plot nowhere/plot.png; says nowhere
run 1 analyze "$banded/frame_2.dng" --plot "$banded/frame_2.dng"; says 'overwrite'

run 2 analyze; says 'which frames'
run 2 analyze "$banded" --readout 5 --camera phone_median; says 'give one'
run 2 analyze "$banded" --readout 0
run 1 analyze "$banded" --camera no_such_camera; says no_such_camera
: >empty.dng
run 1 analyze empty.dng "$banded/frame_1.dng"; says empty.dng
run 1 analyze --json empty.dng; cp out e.json; ok message json e.json error message
run 1 analyze missing.dng; says missing.dng
mkdir ten
for i in 0 1 2 3 4 5 6 7 8 9; do cp "$banded/frame_1.dng" "ten/$i.dng"; done
run 1 analyze ten; says '1 to 9'

# Frames that cannot be compared are measured each by itself: other sizes, equal exposures.
make_small
run 0 analyze small/frame_1.dng "$banded/frame_1.dng" --json; cp out m.json
is compared "$(json m.json frames 0 compared)" false
cp "$banded/frame_1.dng" twin.dng
run 0 analyze "$banded/frame_1.dng" twin.dng --json
finish
