#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Mean colour of DNGs as dcraw develops them: the reference frame as it came,
# as BRACE writes it, merged, and the truth. Prints a Markdown table.
# Usage: bench/colours.sh BUILD FOLDER...   (each with frame_*.dng and gt.dng)
set -euo pipefail
build=$(cd "$1" && pwd)
shift
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

mean() {
    dcraw -c -4 -w -o 1 "$1" >"$work/mean.ppm"
    "$build/tests/cli/cli-helper" mean "$work/mean.ppm" | sed 's/ / /g'
}

echo '| bracket | input frame | written by BRACE | merged | truth |'
echo '|---|---|---|---|---|'
for folder; do
    "$build/src/cli/brace" restore --quiet --method reference "$folder"/frame_*.dng -o "$work/reference.dng"
    "$build/src/cli/brace" restore --quiet --method merge "$folder"/frame_*.dng -o "$work/merged.dng"
    printf '| %s | %s | %s | %s | %s |\n' "$(basename "$folder")" "$(mean "$folder/frame_3.dng")" \
        "$(mean "$work/reference.dng")" "$(mean "$work/merged.dng")" "$(mean "$folder/gt.dng")"
done
