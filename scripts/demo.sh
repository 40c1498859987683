#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Restores the bracket that ships with BRACE and says where the pictures are.
# Usage: scripts/demo.sh BRACE [OUTPUT FOLDER]
set -euo pipefail
brace=${1:-build/release/src/cli/brace}
out=${2:-demo}
here=$(cd "$(dirname "$0")/.." && pwd)
side_by_side=$(dirname "$brace")/../../bench/side_by_side

mkdir -p "$out"
frames=("$here"/data/demo/frame_*.dng)
"$brace" info "${frames[@]}"
echo
"$brace" restore "${frames[@]}" -o "$out/restored.dng" -o "$out/restored.png"
"$brace" restore "${frames[@]}" --method reference -o "$out/reference.png" --quiet
pictures=(restored.dng restored.png reference.png)
if [ -x "$side_by_side" ]; then
    "$side_by_side" "$out/reference.png" "$out/restored.png" "$out/before_after.png"
    pictures+=(before_after.png)
fi

out=$(cd "$out" && pwd)
echo
echo "The pictures:"
for picture in "${pictures[@]}"; do
    case $picture in
        restored.dng) what='the restored frame, for your RAW developer' ;;
        restored.png) what='the restored frame' ;;
        reference.png) what='what a single exposure shows' ;;
        before_after.png) what='both, side by side' ;;
    esac
    printf '  %-45s %s\n' "$out/$picture" "$what"
done
