#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Builds with warnings as errors and runs every test, then builds with Address-
# and UndefinedBehaviorSanitizer and runs them again. The last line counts the
# tests of both runs.
set -uo pipefail
cd "$(dirname "$0")/.." || exit
jobs=$(nproc)
passed=0
failed=0
trap 'kill $(jobs -p) 2>/dev/null' EXIT # what runs beside the others, after Ctrl-C

# run NAME TIMEOUT_MULTIPLIER MESON_OPTION...
run()
{
    local name=$1 multiplier=$2 dir=build/$1 logs=build/$1/meson-logs
    shift 2
    echo "== $name"
    if [ -f "$dir/build.ninja" ]; then
        meson setup --reconfigure "$dir" "$@" >"$dir.log" 2>&1 || { cat "$dir.log"; return 1; }
    else
        mkdir -p build
        meson setup "$dir" "$@" >"$dir.log" 2>&1 || { cat "$dir.log"; return 1; }
    fi
    ninja -C "$dir" -j "$jobs" --quiet || return 1
    rm -f "$logs"/*.json
    # Those of cameras wait more than they compute: one at a time, beside the others.
    local common=(-C "$dir" --no-rebuild --timeout-multiplier "$multiplier" --print-errorlogs)
    meson test "${common[@]}" --suite capture --num-processes 1 --logbase cameras >"$dir.log" 2>&1 &
    meson test "${common[@]}" --no-suite capture --num-processes "$jobs" --logbase others
    wait
    cat "$dir.log"
    cat "$logs/cameras.json" "$logs/others.json" >"$logs/all.json" || return 1
    local good bad
    good=$(grep -cE '"result": "(OK|EXPECTEDFAIL)"' "$logs/all.json")
    bad=$(grep -cE '"result": "(FAIL|ERROR|TIMEOUT|INTERRUPT|UNEXPECTEDPASS)"' "$logs/all.json")
    # What a test needs is installed by scripts/deps.sh where that can be; a browser only for check-slow.
    local skipped
    skipped=$(grep '"result": "SKIP"' "$logs/all.json" | grep -v browser-report | grep -oE '"name": "[^"]*"')
    if [ -n "$skipped" ] && command -v apt-get >/dev/null; then
        printf 'skipped, although everything is installed:\n%s\n' "$skipped"
        bad=$((bad + 1))
    fi
    passed=$((passed + good))
    failed=$((failed + bad))
    # A run that tested nothing is no success.
    [ "$good" -gt 0 ] || [ "$bad" -gt 0 ]
}

export ASAN_OPTIONS=${ASAN_OPTIONS:-detect_leaks=1:allocator_may_return_null=1:abort_on_error=0:handle_sigill=1}

run check 1 -Dwerror=true || failed=$((failed + 1))
echo
export BRACE_TEST_KILLS=4 # twenty moments are for chance, which needs no sanitizer
# -g1: lines for stack traces; all that debuggers know takes a sixth of the time to compile. What is undefined traps:
# calls of a runtime that words it take as long again to compile, and AddressSanitizer tells the line of a trap, too.
run sanitize 6 -Dwerror=true -Dbuildtype=debugoptimized -Db_sanitize=address,undefined -Db_lundef=false \
    -Dbench=false "-Dc_args=['-g1', '-fsanitize-undefined-trap-on-error']" || failed=$((failed + 1))

echo
echo "$passed passed, $failed failed"
[ "$failed" -eq 0 ]
