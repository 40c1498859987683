#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# What people give a program: each mistake has its sentence, its exit code, and leaves no file.
source "$(dirname "$0")/lib.sh"
make_small
mkdir result
f=small/frame_
refuse() { # refuse TEXT... -- ARGUMENT...
    local texts=()
    while [ "$1" != -- ]; do texts+=("$1"); shift; done
    shift
    run 1 restore "$@" -o result/x.dng -o result/x.png
    for text in "${texts[@]}"; do says "$text"; done
    says 'brace: restore: '
    leaves result
}
leaves result

refuse 'missing.dng' 'No such file' -- ${f}1.dng ${f}2.dng missing.dng
refuse 'given twice' 'frame_2.dng' -- ${f}1.dng ${f}2.dng ${f}2.dng ${f}3.dng
ln ${f}2.dng hard.dng
refuse 'same file' 'hard.dng' -- ${f}1.dng ${f}2.dng hard.dng
refuse '3 to 9 frames' '2 were given' -- ${f}1.dng ${f}2.dng
refuse '3 to 9 frames' '1 was given' -- ${f}1.dng
mkdir ten
for i in 1 2 3 4 5 6 7 8 9 10; do cp ${f}3.dng ten/$i.dng; done
refuse '3 to 9 frames' '10 were given' -- ten

"$brace" restore small -q -o photo.jpg
refuse 'photo.jpg' -- ${f}1.dng ${f}2.dng photo.jpg
cp photo.jpg photo.dng
refuse 'photo.dng' -- ${f}1.dng ${f}2.dng photo.dng
: >empty.dng
refuse 'empty.dng' 'empty' -- ${f}1.dng ${f}2.dng empty.dng
mkdir nothing
refuse 'nothing' 'no RAW files' -- nothing
refuse '/dev/null' -- ${f}1.dng ${f}2.dng /dev/null
head -c 20000 ${f}2.dng >short.dng
refuse 'short.dng' -- ${f}1.dng short.dng ${f}3.dng
head -c 100 ${f}2.dng >stub.dng
refuse 'stub.dng' -- ${f}1.dng stub.dng ${f}3.dng
head -c 30000 /dev/urandom >noise.dng
refuse 'noise.dng' -- ${f}1.dng noise.dng ${f}3.dng
echo 'not a photograph' >text.nef
refuse 'text.nef' -- ${f}1.dng text.nef ${f}3.dng

"$helper" edit ${f}4.dng other.dng model=Another
refuse 'other.dng' 'Another' -- ${f}[1235].dng other.dng
"$helper" edit ${f}4.dng small.dng crop=0,0,120,96
refuse 'small.dng' '120' '160' -- ${f}[1235].dng small.dng
"$helper" edit "$root/data/demo/frame_4.dng" cfa.dng crop=201,160,160,128
refuse 'cfa.dng' -- ${f}[1235].dng cfa.dng
for i in 1 2 3 4 5; do "$helper" edit ${f}$i.dng timeless_$i.dng time=0; done
refuse 'timeless_4.dng' 'exposure time' '--exposures' -- ${f}[1235].dng timeless_4.dng
run 0 restore timeless_*.dng -q -o result/given.png --exposures 1/25600,1/6400,1/1600,1/400,0.01; exists result/given.png
run 0 restore small -q -o result/read.png
ok 'as from metadata' cmp result/given.png result/read.png
run 0 restore timeless_*.dng -q -o result/given.png --exposures 1/25600s,1/6400,1/1600,1/400,'1/100"'
rm result/*
mkdir same
for i in 1 2 3 4 5; do cp ${f}3.dng same/$i.dng; done
refuse 'same exposure' -- same

# A frame whose metadata lies is named, but used.
for i in 1 2 3 4 5; do cp ${f}$i.dng liar_$i.dng; done
"$helper" edit ${f}2.dng liar_2.dng time=0.00078125
run 0 restore liar_*.dng -o result/x.png; says 'note: '; says "liar_2.dng"
run 0 restore liar_*.dng -q -o result/x.png; silent
rm result/*

# Black, white and flat frames are strange but no error.
for i in 1 2 3; do "$helper" edit ${f}$i.dng flat_$i.dng flat=64; done
run 0 restore flat_?.dng -q -o result/black.png; exists result/black.png
for i in 1 2 3; do "$helper" edit ${f}$i.dng flat_$i.dng flat=1023; done
run 0 restore flat_?.dng -q -o result/white.png; exists result/white.png
rm result/*

# Flipped bits: any clean ending will do, but no crash and no half-written file.
for seed in $(seq 1 25); do
    "$helper" damage ${f}2.dng damaged.dng "$seed"
    "$brace" restore ${f}1.dng damaged.dng ${f}3.dng -q -o result/x.png >out 2>err </dev/null
    code=$?
    last="restore with damaged.dng, seed $seed"
    checks=$((checks + 1))
    case $code in
        0) rm -f result/x.png ;;
        1) grep -q '^brace: restore: ' err || bad 'no sentence' ;;
        *) bad "exit code $code" ;;
    esac
    leaves result
done

# A folder without permission to write (root may write everywhere).
if [ "$(id -u)" -ne 0 ]; then
    chmod 555 result
    refuse "can't write into" -- small
    chmod 755 result
fi
refuse_output() {
    run 1 restore small -o "$1"
    says "$1"
}
refuse_output /proc/x.png
refuse_output absent/x.dng
: >plain
refuse_output plain/x.dng
finish
