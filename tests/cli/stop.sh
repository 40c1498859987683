#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Ctrl-C at any moment: no half-written file, no temporary left, the old result
# kept, and the exit code a shell expects of an interrupted program.
source "$(dirname "$0")/lib.sh"
mkdir result
make_small frames 200,160,384,288
demo=(frames/frame_*.dng)

start=$(date +%s%N)
run 0 restore "${demo[@]}" -q -o result/a.dng -o result/b.png -o result/c.tif
total=$((($(date +%s%N) - start) / 1000000))
[ "$total" -ge 20 ] || total=20
cp -r result whole
last='restore, stopped'

stopped=0
moments='0 8 20 35 50 65 75 82 88 93 97'
for signal in INT TERM HUP INT,INT; do
    for percent in $moments; do
        rm -f result/*
        echo old >result/a.dng
        code=$("$helper" stop $((total * percent / 100)) $signal "$brace" restore "${demo[@]}" \
            -o result/a.dng -o result/b.png -o result/c.tif 2>err)
        checks=$((checks + 1))
        case $code in
            0) ;;
            129 | 130 | 143) stopped=$((stopped + 1)) ;;
            *) bad "$signal at $percent %: exit code $code" ;;
        esac
        for file in result/* result/.[!.]*; do
            [ -e "$file" ] || continue
            file=${file#result/}
            checks=$((checks + 1))
            if [ "$file" = a.dng ] && [ "$(head -c 3 result/a.dng)" = old ]; then
                continue
            fi
            [ -e "whole/$file" ] && cmp -s "result/$file" "whole/$file" || bad "$signal at $percent %: left $file"
        done
        exists result/a.dng
    done
    moments='10 50 90'
done
checks=$((checks + 1))
[ "$stopped" -ge 4 ] || bad "only $stopped runs were stopped; the test is too slow to tell"
finish
