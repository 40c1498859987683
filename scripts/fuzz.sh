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
mkdir -p $dir/corpus/raw $dir/corpus/picture $dir/corpus/safetensors $dir/corpus/pth $dir/corpus/sequence \
    $dir/corpus/choices $dir/corpus/protocol $dir/corpus/json
$dir/fuzz/make_seeds $dir/corpus/raw $dir/corpus/picture $dir/corpus/safetensors $dir/corpus/protocol
cp tests/nn/data/*.pth $dir/corpus/pth/
cp fuzz/seeds/sequence/* $dir/corpus/sequence/
cp fuzz/seeds/choices/* $dir/corpus/choices/
cp data/displays/*.json data/cameras/*.json data/priors/*.json data/configs/*.json $dir/corpus/json/

failed=0
for target in raw picture safetensors pth protocol sequence choices json; do
    echo "== fuzz_$target for $seconds s"
    $dir/fuzz/fuzz_$target -max_total_time="$seconds" -timeout=20 -rss_limit_mb=3072 -max_len=65536 -print_final_stats=1 \
        -verbosity=0 -artifact_prefix=$dir/ $dir/corpus/$target || failed=$((failed + 1))
done
[ $failed -eq 0 ] && echo "no crash"
exit $failed
