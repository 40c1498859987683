#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Runs every libFuzzer target for some time, starting from the demo's files.
# Usage: scripts/fuzz.sh [SECONDS A TARGET]
set -euo pipefail
cd "$(dirname "$0")/.."
seconds=${1:-120}
dir=build/fuzz

command -v clang >/dev/null || { echo "fuzz: clang is missing (apt-get install clang)" >&2; exit 1; }
if [ ! -f $dir/build.ninja ]; then
    CC=clang meson setup $dir -Dbuildtype=debugoptimized -Db_sanitize=address,undefined -Db_lundef=false \
        -Dfuzz=true -Dtests=false -Dbench=false
fi
ninja -C $dir -j "$(nproc)" --quiet

# Seeds: small ones fuzz fastest, so DNGs are cut from the demo's by the seed maker.
mkdir -p $dir/corpus/raw $dir/corpus/picture $dir/corpus/safetensors $dir/corpus/pth $dir/corpus/choices
$dir/fuzz/make_seeds $dir/corpus/raw $dir/corpus/picture $dir/corpus/safetensors
cp tests/nn/data/*.pth $dir/corpus/pth/
printf '%s\n' 1/250 0.0040s 10/25 1/1.3 '1 1/3' 2m 30s Bulb 'x 200' >$dir/corpus/choices/exposures
printf '%s\n' 'ISO 100' 6400 'Auto ISO' f/5.6 'NEF (Raw)' 'cRAW + Large Fine JPEG' capt0000.cr3 >$dir/corpus/choices/others

failed=0
for target in raw picture safetensors pth choices; do
    echo "== fuzz_$target for $seconds s"
    $dir/fuzz/fuzz_$target -max_total_time="$seconds" -timeout=20 -rss_limit_mb=3072 -max_len=65536 -print_final_stats=1 \
        -verbosity=0 -artifact_prefix=$dir/ $dir/corpus/$target || failed=$((failed + 1))
done
[ $failed -eq 0 ] && echo "no crash"
exit $failed
