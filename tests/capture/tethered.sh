#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# A tethered camera from beginning to end: brace capture with the real libgphoto2
# over PTP/IP, the test camera in front of a simulated display, brace restore.
# Arguments: those of lib.sh, and the test camera.
ptpip=$(realpath "$4")
source "$(dirname "$0")/../cli/lib.sh"
if [ ! -x "$ptpip" ]; then
    run 2 capture run -o none --camera gphoto2:ptpip:127.0.0.1:1
    says 'made without libgphoto2'
    [ "$failures" -eq 0 ] || finish
    echo 'skipped: tethered cameras are not in this build, which was made without libgphoto2'
    exit 77
fi
export HOME=$work # where the library keeps its settings
# The library's own leaks cannot be told from ours in a program that unloads its drivers; leaks.c, of the other test, can.
export ASAN_OPTIONS=${ASAN_OPTIONS:-}:detect_leaks=0

# camera ARGUMENT...: starts one; its address is in $at.   tally: ends it; what it counted is in ./tally.
camera() {
    rm -f ready
    coproc CAMERA { exec "$ptpip" ready size=384x256 "$@" >tally 2>camera.err; }
    camera_pid=$CAMERA_PID
    camera_in=${CAMERA[1]}
    local i
    for ((i = 0; i < 600; i++)); do
        [ ! -s ready ] || break
        sleep 0.05
    done
    [ -s ready ] || bad "the camera did not start: $(cat camera.err)"
    at=gphoto2:ptpip:127.0.0.1:$(cat ready)
}
tally() {
    exec {camera_in}>&-
    wait "$camera_pid"
}
counted() {
    is "the camera's $1" "$(json tally "$1")" "$2"
}

# What there is, what would be done, and doing it.
for kind in '' maker; do
    camera $kind
    run 0 capture list --camera "$at" --json
    prints '"model": "Test Camera'
    run 0 capture plan --camera "$at" --time 1/60
    run 0 capture run -q -o "seq$kind" --camera "$at" --time 1/60
    tally
    counted restored true
    counted rejected 0
    counted exposures 6
    exists "seq$kind/gt.dng"
    run 0 capture check "seq$kind"
    run 0 restore -q "seq$kind"/frame_*.dng -o "seq$kind.png" -o "seq$kind.dng"
    exists "seq$kind.png"
    exists "seq$kind.dng"
done

# A bad day: every frame is shot again until it is right.
camera fault=busy-open@3x3 fault=busy-set@3x2 fault=busy-shoot@2x3 fault=busy-download@2x1 fault=drop-shoot@6x1 \
    fault=drop-download@5x1 fault=truncate@4x1 fault=no-object@4x1 fault=keep@6x1 fault=lie@7x1
run 0 capture run -o bad --camera "$at" --time 1/60 --json
tally
counted restored true
counted faults 15
run 0 capture check bad
run 0 restore -q bad/frame_*.dng -o bad.png
exists bad.png

# What cannot be helped is said, and nothing is left under the sequence's name.
camera fault=full@3xall
run 1 capture run -q -o full --camera "$at" --time 1/60
says 'Full'
tally
counted restored true
absent full
camera fault=jpeg@1xall
run 1 capture run -q -o jpeg --camera "$at" --time 1/60
says 'RAW'
tally
absent jpeg
run 1 capture run -q -o gone --camera gphoto2:ptpip:127.0.0.1:1
says 'does not answer'
absent gone

# Ctrl-C while the camera is silent: its settings come back, and the sequence can be gone on with.
camera fault=no-event@3x1
code=$("$helper" stop .capture-again/sequence.json+2000 INT "$brace" capture run -q -o again --camera "$at" --time 1/60 2>err)
is 'exit code after Ctrl-C' "$code" 130
absent again
run 0 capture run -q -o again --camera "$at" --resume
exists again/gt.dng
tally
counted restored true
finish
