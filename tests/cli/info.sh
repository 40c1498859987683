#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# brace info: one frame, a bracket, what is no bracket, JSON.
source "$(dirname "$0")/lib.sh"
make_small

run 0 info small/frame_3.dng
prints 'Phone Median phone'; prints '160 x 128'; prints '256, 4095'; prints '1/1600 s'; prints '100'; prints 'f/1.8'
prints 'D65'; prints '1.2500'; prints '0.4293'; prints 'as stored'; prints '2000:01:01'; prints '6.8e-07'
prints '6.8 mm'

run 0 info small/frame_5.dng small/frame_1.dng small/frame_2.dng small/frame_3.dng small/frame_4.dng
prints '+4.00'; prints '-4.00'; prints '+0.00'; prints 'A bracket of 5 frames; reference frame_3.dng'
run 0 info small; prints 'reference frame_3.dng'
run 0 info small/frame_1.dng small/frame_2.dng; prints '1/6400 s'

"$helper" edit small/frame_4.dng other.dng model=Another
run 0 info small/frame_[123].dng other.dng; prints 'No bracket'; prints 'other.dng'
"$helper" edit small/frame_4.dng timeless.dng time=0
run 0 info small/frame_[123].dng timeless.dng; prints 'No bracket'; prints 'timeless.dng'; prints '?'
"$helper" edit small/frame_2.dng liar.dng time=0.0003125
run 0 info small/frame_[1345].dng liar.dng; prints 'the pixels say'

run 0 info --json small/frame_*.dng; cp out i.json
is frames "$(json i.json frames count)" 5
is make "$(json i.json frames 0 make)" Phone
is cfa "$(json i.json frames 0 cfa)" RGGB
is black "$(json i.json frames 0 black 3)" 256
is white "$(json i.json frames 0 white)" 4095
is iso "$(json i.json frames 0 iso)" 100
is ev "$(json i.json frames 4 ev)" 4
is illuminant "$(json i.json frames 0 color_matrices 0 illuminant)" 21
is matrix "$(json i.json frames 0 color_matrices 0 matrix count)" 9
is complete "$(json i.json bracket complete)" true
is reference "$(json i.json bracket reference)" small/frame_3.dng
run 0 info --json small/frame_[123].dng other.dng; cp out i.json
is complete "$(json i.json bracket complete)" false
ok problem json i.json bracket problem
run 0 info --json small/frame_1.dng; cp out i.json; is bracket "$(json i.json bracket)" null

# A damaged file among good ones: it is named, the others are shown, the exit code says so.
: >empty.dng
run 1 info small/frame_1.dng empty.dng small/frame_2.dng; says 'empty.dng'; prints 'frame_2.dng'
run 1 info --json small/frame_1.dng empty.dng; cp out i.json; is frames "$(json i.json frames count)" 1

# A name that is not UTF-8 still gives valid JSON.
odd=$(printf 'caf\351.dng')
cp small/frame_1.dng "$odd"
run 0 info --json "$odd"; cp out i.json; is path "$(json i.json frames 0 path)" 'caf?.dng'
finish
