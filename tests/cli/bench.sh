#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# brace bench: usage, tables, JSON with every driver's kernels close to plain C, and what goes wrong.
source "$(dirname "$0")/lib.sh"
export BRACE_DATA=$root/data

run 0 bench --help; prints 'brace bench NAME'; prints 'sim'
run 0 help bench; prints 'sim'
run 0 bench sim --help; prints '--display'; prints 'Examples'
run 2 bench; says 'which bench'
run 2 bench sin; says "did you mean 'sim'?"
run 2 bench xyzzyplugh; says "no bench 'xyzzyplugh'"
run 2 bench sim led_wall_3840_16; says '--display'
run 2 bench sim --size 64; says "not '64'"
run 2 bench sim --size 64x48x; says '--size'
run 2 bench sim --size 0x48; says '--size'
run 2 bench sim --fast; says 'no option --fast'
run 1 bench sim --quick -q --size 16x16; says '16 is out of range 32'
run 1 bench sim --quick -q --display plasma; says 'plasma'; says 'led_wall_3840_16'
run 1 bench sim --quick -q --camera box; says 'box'
run 1 bench sim --quick -q --json --display plasma; prints '"error"'

# Every driver, with every instruction set that is there: light and frames at some speed, next to plain C.
run 0 bench sim --quick --json -q --size 64x48
cp out all.json
is 'bench' "$(json all.json bench)" sim
is 'size' "$(json all.json width) $(json all.json height) $(json all.json frames)" '64 48 5'
is 'displays' "$(json all.json displays count)" 7
for i in 0 1 2 3 4 5 6; do
    drivers="${drivers:-}$(json all.json displays $i driver) "
    for rate in 'light plain' 'frame plain'; do
        # shellcheck disable=SC2086
        ok "$rate of display $i" awk -v x="$(json all.json displays $i $rate)" 'BEGIN {exit !(x > 0)}'
    done
    for set in avx2 avx512; do
        off=$(json all.json displays $i deviation $set 2>/dev/null) || continue
        ok "$set is off by $off" awk -v x="$off" 'BEGIN {exit !(x >= 0 && x < 1e-5)}'
    done
done
is 'drivers' "$drivers" 'dc lcd_pwm lcd_pwm oled_pwm led_spwm bcm raster '

# BRACE_CPU leaves sets out.
BRACE_CPU=plain run 0 bench sim --quick --json -q --size 64x48 -d steady
ok 'plain C is measured' json out displays 0 frame plain
checks=$((checks + 1))
! json out displays 0 frame avx2 >/dev/null 2>&1 || bad 'AVX2 was measured though it was left out'

# Two displays of one's choice as a table.
run 0 bench sim --quick --hand --size 64x48 -d steady --display crt_60
prints 'crt_60'; prints 'Whole frames'; prints '64x48'
is 'lines of displays' "$(grep -c 'steady\|crt_60' out)" 4
says 'measuring'
run 0 bench sim --quick -q --size 64x48 -d steady
is 'what is on stderr' "$(cat err)" ''

# Convolutions.
run 0 bench conv --help; prints '--channels'; prints 'Examples'
run 2 bench conv 64; says 'no argument'
run 2 bench conv --channels 64; says "not '64'"
run 2 bench conv --channels 64:0; says '--channels'
run 2 bench conv --size 64; says "not '64'"
run 0 bench conv --quick --json -q --channels 3:5 --size 9x7
is 'bench' "$(json out bench)" conv
is 'size' "$(json out convolutions count) $(json out convolutions 0 width) $(json out convolutions 0 height)" '1 9 7'
is 'first method' "$(json out methods 0 method)" ref
for pass in forward backward_data backward_weights; do
    ok "$pass" awk -v x="$(json out convolutions 0 $pass 'ref f32')" 'BEGIN {exit !(x > 0)}'
done
BRACE_CPU=plain run 0 bench conv --quick -q -t 1 -c 3:5 --size 9x7
prints 'backward_weights'; prints '1 thread'
checks=$((checks + 1))
! grep -q avx out || bad 'AVX was measured though it was left out'

# A network.
run 0 bench model --help; prints '--blocks'; prints 'Examples'
run 2 bench model 64; says 'no argument'
run 2 bench model --size 64x; says "not '64x'"
run 0 bench model --quick --json -q --blocks 2 --channels 5 --size 9x7
is 'bench' "$(json out bench)" model
is 'types' "$(json out runs 0 type) $(json out runs 1 type) $(json out blocks)" 'f32 bf16 2'
for pass in forward training_step; do
    ok "$pass" awk -v x="$(json out runs 1 $pass seconds)" -v y="$(json out runs 0 $pass plan_mb)" 'BEGIN {exit !(x > 0 && y > 0)}'
done
BRACE_CPU=plain run 0 bench model --quick -q -t 1 --blocks 3 -c 4 --size 8x8 --recompute
prints 'training_step'; prints '1 thread'; prints 'recomputed'

# Stopped.
got=$("$helper" stop 300 INT "$brace" bench sim -q --size 160x120 2>err)
last='bench sim, stopped'
is 'exit code' "$got" 130
finish
