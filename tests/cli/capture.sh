#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# brace capture: usage, plans, a sequence from the simulated camera to a picture and into a set, faults, interruptions.
source "$(dirname "$0")/lib.sh"
export BRACE_DATA=$root/data
sim=(--camera sim --option size=192x144)

run 0 capture --help; prints 'check'
run 0 help capture; prints 'plan'
for a in list plan run check; do
    run 0 capture $a --help; prints 'Example'
done
run 2 capture; says 'which action'
run 2 capture rn; says "did you mean 'run'"
run 2 capture run --camera sim; says '-o DIR'
run 2 capture run -o x; says 'brace capture list'
run 2 capture run -o x --camera polaroid; says 'there are: sim'
run 2 capture run -o x --camera sim --resume --restart; says 'either'
run 2 capture run -o x --camera sim --time 0; says '--time 0'
run 2 capture run -o x --camera sim --shots 1,2 --frames 3; says '--shots'
run 2 capture run -o x --camera sim --shots 1,2,y; says "'y'"
run 2 capture plan --flicker 0; says '--flicker'
run 2 capture plan --step 1
run 2 capture check; says 'which folder'
run 1 capture run -o x --camera sim --fault busy; says 'KIND:N'
run 1 capture run -o x --camera sim --option color=red; says 'screen, display'
run 1 capture run -o x --camera sim:nikon_1; says 'nikon_1'
run 1 capture check nowhere; says 'nowhere'
absent x
absent .capture-x

# Plans: the paper's, and what a camera makes of it.
run 0 capture plan --time 1/320 --iso 400 --flicker 240 --flicker 50
prints '1/5120 s'; prints '12.0*'; prints 'reference'; prints 'truth'
run 0 capture plan --camera sim:canon_r5 --iso 400 --json
cp out plan.json
is 'first' "$(json plan.json plan 0 name)" frame_5
is 'parts' "$(json plan.json plan 5 shots)" 2
is 'exposures' "$(json plan.json exposures)" 7
says 'mean of 2 shots'
# libgphoto2 loads its drivers, which leak, and unloads them: leaks of its own cannot be told from ours there.
ASAN_OPTIONS=${ASAN_OPTIONS:-}:detect_leaks=0 run 0 capture list; prints '--camera sim'; prints 'ISO 50 to 6400'; prints 'display=NAME'
run 0 capture list --camera sim:canon_r5 --json
cp out list.json
is 'model' "$(json list.json cameras 0 limits iso 0)" 100

# From the shutter to a picture, and into a set.
run 0 capture run -o set/one "${sim[@]}" --option display=led_wall_3840_16; prints 'reference'; prints '6 releases'
leaves set one
leaves set/one frame_1.dng frame_2.dng frame_3.dng frame_4.dng frame_5.dng gt.dng sequence.json
run 0 restore set/one/*.dng -o a.png; says 'gt.dng is the truth'
run 0 restore set/one -o b.png --quiet; silent
run 0 restore set/one/frame_*.dng -o c.png --quiet
ok 'the truth is not among the frames' cmp a.png c.png
ok 'nor of a folder' cmp b.png c.png
run 0 dataset import set -o imported --reduce 2 --tolerance 3 --quiet
leaves imported one
run 0 capture check set/one --json
cp out check.json
is 'importable' "$(json check.json folders 0 importable)" true
is 'restorable' "$(json check.json folders 0 restorable)" true
run 1 capture run -o set/one "${sim[@]}"; says 'is there already'

# The seed decides.
run 0 capture run -o again "${sim[@]}" --option display=led_wall_3840_16 --quiet --threads 1; silent
for f in frame_1.dng frame_3.dng gt.dng sequence.json; do
    ok "the same $f again" cmp set/one/$f again/$f
done
run 0 capture run -o many "${sim[@]}" --repeat 2 --frames 3 --no-truth --quiet
leaves many 01 02
leaves many/01 frame_1.dng frame_2.dng frame_3.dng sequence.json
checks=$((checks + 1))
! cmp -s many/01/frame_1.dng many/02/frame_1.dng || bad 'both sequences are the same'
run 1 capture run -o many "${sim[@]}" --repeat 2 --frames 3 --no-truth --quiet; says 'is there already'
run 1 capture run -o more "${sim[@]}" --repeat 3 --frames 3 --no-truth --quiet --fault full:5+; says '--resume'
leaves more 01 .capture-02
cp more/01/frame_1.dng first.dng; cp more/.capture-02/frame_3.dng third.dng
run 0 capture run -o more "${sim[@]}" --repeat 3 --frames 3 --no-truth --quiet --resume
leaves more 01 02 03
ok 'what was there stays' cmp more/01/frame_1.dng first.dng
ok 'and what was interrupted' cmp more/02/frame_3.dng third.dng

# Faults: told, shot again, named.
run 0 capture run -o f "${sim[@]}" --fault busy:1,drop:3,same:6,disconnect:8; says 'dropped the frame'; says 'same picture'
prints '1 times busy'; prints '1 lost'; prints '1 times reconnected'; prints '1 with wrong light'
run 1 capture run -o g "${sim[@]}" --fault shutter:6+; says 'darker'; says '--accept'; says '--resume'
absent g
run 1 capture run -o g "${sim[@]}"; says '--resume'
run 0 capture run -o g "${sim[@]}" --resume --quiet
leaves g frame_1.dng frame_2.dng frame_3.dng frame_4.dng frame_5.dng gt.dng sequence.json
absent .capture-g
cp g/frame_2.dng g/frame_4.dng
run 1 capture check g; prints 'frame_4.dng was changed'; prints 'same picture'; prints 'should not be given it'
run 1 capture check g --quiet; silent

# Stopped: what is shot stays, nothing else, and it goes on from there.
"$brace" capture run -o h --camera sim --option size=2048x1536 >out 2>err &
pid=$!
for _ in $(seq 400); do
    [ -f .capture-h/frame_2.dng ] && break
    sleep 0.05
done
kill -TERM $pid
wait $pid
is "exit code" $? 143
absent h
says '--resume'
ok 'no temporary is left' test -z "$(find .capture-h -name '.*' -type f)"
run 0 capture run -o h --camera sim --option size=2048x1536 --resume --quiet
leaves h frame_1.dng frame_2.dng frame_3.dng frame_4.dng frame_5.dng gt.dng sequence.json

finish
