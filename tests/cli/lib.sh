# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# lib.sh: what the command line tests share. Sourced with the script's own
# arguments: BRACE HELPER SOURCE_ROOT. Each script works in its own empty folder.

brace=$(realpath "$1")
helper=$(realpath "$2")
root=$(realpath "$3")
export brace helper root
export BRACE_MODELS=/nonexistent # tests that need a network make one
work=$(mktemp -d)
trap 'cd /; rm -rf "$work"' EXIT
cd "$work" || exit 1
checks=0
failures=0

# A small bracket of the demo's, so that the tests are quick: small/frame_1..5.dng
make_small() {
    local i
    mkdir -p "${1:-small}"
    for i in 1 2 3 4 5; do
        "$helper" edit "$root/data/demo/frame_$i.dng" "${1:-small}/frame_$i.dng" crop="${2:-200,160,160,128}" || exit 1
    done
}

bad() {
    failures=$((failures + 1))
    printf 'FAILED: %s\n' "$1"
    [ -z "${last:-}" ] || printf '   after: brace %s\n' "$last"
    [ ! -s err ] || sed 's/^/   stderr: /' err
}

# run CODE ARGUMENT...: runs brace and expects this exit code; its output is in ./out and ./err.
run() {
    local want=$1 got
    shift
    last="$*"
    checks=$((checks + 1))
    "$brace" "$@" >out 2>err </dev/null
    got=$?
    [ "$got" -eq "$want" ] || bad "exit code $got instead of $want"
}

# says TEXT: it is on stderr of the last run.   prints TEXT: on stdout.
says() {
    checks=$((checks + 1))
    grep -qF -- "$1" err || bad "stderr does not say '$1'"
}
prints() {
    checks=$((checks + 1))
    grep -qF -- "$1" out || bad "stdout does not say '$1'"
}
# silent: nothing at all was printed.
silent() {
    checks=$((checks + 1))
    { [ ! -s out ] && [ ! -s err ]; } || bad "it was not silent"
}
# is WHAT GOT WANTED
is() {
    checks=$((checks + 1))
    [ "$2" = "$3" ] || bad "$1 is '$2' instead of '$3'"
}
# ok WHAT COMMAND...
ok() {
    local what=$1
    shift
    checks=$((checks + 1))
    "$@" >/dev/null || bad "$what"
}
exists() {
    checks=$((checks + 1))
    [ -s "$1" ] || bad "$1 was not written"
}
absent() {
    checks=$((checks + 1))
    [ ! -e "$1" ] || bad "$1 exists"
}
# leaves FOLDER NAME...: the folder holds exactly these.
leaves() {
    local folder=$1
    shift
    is "the content of $folder" "$(ls -A "$folder" | sort | tr '\n' ' ')" "$([ $# -eq 0 ] || printf '%s\n' "$@" | sort | tr '\n' ' ')"
}
json() {
    "$helper" json "$@"
}
# alone FILE: it loads nothing, runs nothing from a name, and is UTF-8 without control characters.
alone() {
    ok "$1 is UTF-8" iconv -f UTF-8 -t UTF-16 "$1"
    is "addresses in $1" "$(grep -cE 'https?:|//[a-z]+\.|url\(|@import|<link|<iframe|<object|<base|href=' "$1")" 0
    is "pictures of $1 from elsewhere" "$(grep -oE 'src="[^"]{5}' "$1" | grep -cvF 'src="data:')" 0
    is "scripts of $1" "$(grep -c '<script' "$1")" 1
    is "handlers in $1" "$(grep -cE '<[^>]*[[:space:]]on[a-z]+=' "$1")" 0
    ok "$1 is whole" grep -q '</html>' "$1"
    ok "$1 forbids the network" grep -q "default-src 'none'" "$1"
    is "control characters in $1" "$(LC_ALL=C grep -cP '[\x00-\x08\x0b-\x1f\x7f]' "$1")" 0
}
finish() {
    echo "$checks checks, $failures failed"
    [ "$failures" -eq 0 ]
    exit
}
