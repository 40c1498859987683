#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Help, versions, and every way to call it wrongly: exit code 2 and a hint.
source "$(dirname "$0")/lib.sh"
make_small
cp small/frame_3.dng before.dng

run 0 --help; prints 'restore'; prints 'info'; prints 'Usage: brace'
run 0 -h; prints 'Usage: brace'
run 0 help; prints 'Usage: brace'
run 0 help restore; prints '--exposures'; prints '--method'
run 0 restore --help; prints '--output'; prints 'Examples'
run 0 help info; prints '--json'
run 0 --version; prints "brace $VERSION"; prints 'LibRaw'; prints 'libtiff'

run 2; says 'which command'
run 2 restroe; says "did you mean 'brace restore'?"
run 2 inf; says 'brace info'
run 2 help restor; says "did you mean 'brace restore'?"
run 2 xyzzyplugh; says 'brace --help'
run 2 --json restore; says 'the command comes first'
run 2 ''; says 'no command'

run 2 restore; says 'which files'
run 2 info; says 'which files'
run 2 restore small/*.dng; says '-o restored.dng'
run 2 restore small/*.dng -o; says '-o needs a value'
run 2 restore small/*.dng --output; says '--output needs a value'
run 2 restore small/*.dng -o x.png --metod merge; says 'did you mean --method?'
run 2 restore small/*.dng -o x.png --expo 1; says 'could be'
run 2 restore small/*.dng -o x.png --frobnicate; says 'there is no option --frobnicate'; says "brace restore --help"
run 2 restore small/*.dng -o x.png -Z; says 'no option -Z'
run 2 restore small/*.dng -o x.png --json=1; says 'takes no value'
run 2 restore small/*.dng -o x.png --method median; says 'merge or reference'
run 2 restore small/*.dng -o x.png --threads 0; says '1 to 256'
run 2 restore small/*.dng -o x.png --threads 1.5; says 'whole number'
run 2 restore small/*.dng -o x.png --threads many; says "not 'many'"
run 2 restore small/*.dng -o x.jpg --quality 101; says '1 to 100'
run 2 restore small/*.dng -o x.png --bits 12; says '8, 16 or 32'
run 2 restore small/*.dng -o x.jpg --bits 16; says 'fits none'
run 2 restore small/*.dng -o x.png --bits 32; says 'fits none'
run 2 restore small/*.dng -o x.png --exposure nan; says 'from -10 to 10'
run 2 restore small/*.dng -o x.png --reference 6; says '1 to 5'
run 2 restore small/*.dng -o x.png --reference 0; says '1 to 5'
run 2 restore small/*.dng -o x.png --reference nobody.dng; says 'none of the frames'
run 2 restore small/*.dng -o x.png --exposures 1/2,1; says '2 times for 5 frames'
run 2 restore small/*.dng -o x.png --exposures 1,2,3,4,x; says "'x' is no exposure time"
run 2 restore small/*.dng -o x.png --exposures 1,2,3,4,1/0; says 'no exposure time'
run 2 restore small/*.dng -o x.png --exposures 1,2,3,4,-1; says 'no exposure time'

# Outputs are looked at before the work, and before any frame is read.
run 2 restore small/*.dng -o result; says 'has to end in .dng'
run 2 restore small/*.dng -o x.gif; says 'has to end in .dng'
run 2 restore small/*.dng -o ''; says 'has to end in'
run 2 restore small/*.dng -o x --format gif; says '--format is one of'
run 2 restore small/*.dng -o x.png --format dng; says 'named as PNG'
run 2 restore small/*.dng -o x.png -o ./x.png; says 'given twice'
run 2 restore small/*.dng -o small/frame_3.dng; says 'one of the inputs'
ln -s small/frame_2.dng link.dng
run 2 restore small/*.dng -o link.dng; says 'one of the inputs'
mkdir folder.png
run 2 restore small/*.dng -o folder.png; says 'is a folder'
run 1 restore small/*.dng -o nowhere/x.png; says 'nowhere/'
absent x.png
ok 'the inputs are untouched' cmp small/frame_3.dng before.dng

# Options in all their spellings, and names that look like options.
run 0 restore -q -ox.png small/*.dng; silent; exists x.png
run 0 restore --quiet --output=y.png -- small/*.dng; exists y.png
run 0 restore small/*.dng -qo z.png; exists z.png
cp small/frame_1.dng ./-o.dng
run 2 restore -o.dng small/frame_[345].dng
run 0 restore -qo dash.png -- -o.dng small/frame_[2345].dng; exists dash.png

# A reader that goes away is an error, not a crash.
is 'a full device' "$("$brace" --help >/dev/full 2>/dev/null; echo $?)" 1
mkfifo pipe
{ sleep 0.2; "$brace" help restore >&3 2>err; echo $? >code; } 3>pipe &
: <pipe
wait $!
ok "a closed pipe: exit code $(cat code)" grep -qxE '1|141' code
finish
