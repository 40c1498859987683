#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# brace model: what a file of weights says, the same weights in half the size, checkpoints of PyTorch.
source "$(dirname "$0")/lib.sh"
make_small
"$helper" network net.safetensors brace-s || exit 1

run 0 model net.safetensors; prints 'brace-s'; prints 'parameters'; prints 'MSCAM: yes'
run 0 model net.safetensors --json; cp out r.json
is model "$(json r.json model)" brace-s
ok parameters test "$(json r.json parameters)" -gt 100

run 0 model net.safetensors -o again.safetensors

# Half the size, nearly the same picture.
for type in f16 bf16; do
    run 0 model net.safetensors -o $type.safetensors --type $type
    ok "smaller" test "$(stat -c %s $type.safetensors)" -lt "$(stat -c %s again.safetensors)"
    run 0 restore small -qo $type.png --model ./$type.safetensors
done
run 0 restore small -qo f32.png --model ./net.safetensors
ok 'f16 hardly differs' "$helper" same f32.png f16.png 2
ok 'bf16 hardly differs' "$helper" same f32.png bf16.png 2
run 0 restore small -qo again.png --model ./again.safetensors
ok 'f32 is the same' cmp f32.png again.png

# What cannot be.
run 1 model small/frame_1.dng; says 'frame_1.dng'
run 1 model nothing.safetensors; says 'nothing.safetensors'
run 1 model nothing.pth --network tmrnet; says 'nothing.pth'
run 2 model net.safetensors --network nonsense -o x.safetensors; says 'nonsense'; absent x.safetensors
run 1 model net.safetensors --network tmrnet -o x.safetensors; says 'brace-s, not for tmrnet'; absent x.safetensors
run 2 model; says 'which file'
run 2 model net.safetensors --type f8; says 'f8'
run 1 model net.safetensors -o nowhere/x.safetensors; says 'nowhere'
finish
