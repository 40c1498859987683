#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# scripts/demo.sh, which the README's first command runs.
source "$(dirname "$0")/lib.sh"
last='scripts/demo.sh'
unset BRACE_MODELS # as users have it: with the weights that ship
bash "$root/scripts/demo.sh" "$brace" shown >out 2>err; is 'exit code' $? 0
says 'network brace-s'
for file in restored.dng restored.png reference.png; do
    exists "shown/$file"
    prints "shown/$file"
done
finish
