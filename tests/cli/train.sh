#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# brace train: a run's files, what is refused, and runs that are killed at any moment and go on.
source "$(dirname "$0")/lib.sh"

# BRACE_TEST_KILLS: for sanitizers, which take their time, fewer kills of a shorter run.
samples=20
[ -z "${BRACE_TEST_KILLS:-}" ] || samples=12
config() {
    cat <<JSON
{ "model": "$1", "seed": 3, "batch": 4, "epochs": 2, "epoch_samples": $samples, "checkpoint_steps": 1,
  "network": {"channels": 8, "global": 1, "frame": 1, "extract": 0, "reconstruct": 0},
  "data": {"width": 96, "height": 96, "crop": 16, "crops": 2, "transpose": false},
  "validation": {"samples": 2}, "optimizer": {"rate": 0.001, "average": 0.5} }
JSON
}
config brace-s >tiny.json

# A run, undisturbed.
start=$(date +%s%N)
run 0 train tiny.json -o whole -t 1 --json; cp out r.json
total=$((($(date +%s%N) - start) / 1000000))
is steps "$(json r.json steps)" $((samples / 2))
is samples "$(json r.json samples)" $((samples * 2))
exists whole/weights.safetensors; exists whole/plot.png; exists whole/config.json; exists whole/sheets/epoch_0002.png
is 'lines of the log' "$(wc -l <whole/log.jsonl)" $((samples / 2 + 2))
run 0 model whole/weights.safetensors; prints "$((samples / 2)) steps"
make_small
run 0 restore small -qo a.png --model ./whole/weights.safetensors; exists a.png
run 1 train tiny.json -o whole; says '--resume'
run 0 train tiny.json -o whole --resume -q; silent # it is done
sed 's/"seed": 3/"seed": 4/' tiny.json >other.json
run 1 train other.json -o whole --resume; says "'seed' differs"

# Killed at many moments, it ends with the same bytes.
RANDOM=7 kills=0
for _ in $(seq "${BRACE_TEST_KILLS:-20}"); do
    "$brace" train tiny.json -o killed -t 1 --resume -q &
    ms=$((total * (RANDOM % 40 + 5) / 100))
    sleep "$(printf '%d.%03d' $((ms / 1000)) $((ms % 1000)))"
    kill -9 $! 2>/dev/null && kills=$((kills + 1))
    wait $! 2>/dev/null
done
run 0 train tiny.json -o killed -t 1 --resume
ok "weights after $kills kills" cmp whole/weights.safetensors killed/weights.safetensors
ok 'the state' cmp whole/checkpoint.safetensors killed/checkpoint.safetensors
ok 'it was killed' test $kills -gt 0
leaves killed checkpoint.safetensors config.json log.jsonl plot.png sheets weights.safetensors
times() { sed 's/"seconds":[^,]*,//; s/"waited":[^,]*,//; s/"samples_per_second":[^,}]*//' "$1"; }
is 'the log' "$(times killed/log.jsonl | md5sum)" "$(times whole/log.jsonl | md5sum)"

# Ctrl-C saves and says how to go on.
sed 's/"epoch_samples": [0-9]*/"epoch_samples": 100000/' tiny.json >long.json # does not end by itself
is 'exit code after Ctrl-C' "$("$helper" stop stopped/checkpoint.safetensors+0 INT "$brace" train long.json -o stopped -t 1 2>err)" 130
last='train, stopped'
says '--resume goes on'; exists stopped/checkpoint.safetensors
run 1 train long.json -o stopped; says '--resume'

# Two processes share each batch, with the same result but for rounding.
if [ "${BRACE_TEST_MPIRUN:-}" != "" ]; then
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
    ok 'two processes' $BRACE_TEST_MPIRUN -n 2 "$brace" train tiny.json -o two -t 1 -q
    run 0 restore small -qo b.png --model ./two/weights.safetensors
    ok 'nearly the same network' "$helper" same a.png b.png 2
fi

# What cannot be.
run 2 train; says 'which configuration'
run 1 train nothing.json; says 'nothing.json'
config nonsense | grep -v network >bad.json
run 1 train bad.json -o bad; says 'brace-s'; absent bad/weights.safetensors
sed 's/"channels": 8/"channels": 9999/' tiny.json >bad.json
run 1 train bad.json -o bad; says 'channels'
sed 's/"batch": 4/"batches": 4/' tiny.json >bad.json
run 1 train bad.json -o bad; says 'batches'
printf '{' >bad.json
run 1 train bad.json; says 'bad.json'
touch file
run 1 train tiny.json -o file/run; says 'file'
finish
