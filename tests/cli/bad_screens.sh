#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# What people give the simulator: screens, presets and folders that are wrong, or very small or large. Each mistake has
# its sentence and exit code 1, and no half sample is left.
source "$(dirname "$0")/lib.sh"
export BRACE_DATA=$root/data
good=$root/data/screens/000009_static.webp
small=(--size 64x48 --quiet)

# One pixel is a lamp.
"$helper" white one.png 1
run 0 simulate one.png -o lamp "${small[@]}"; silent
run 0 dataset verify lamp; prints '1 samples, 0 bad'

# A sound picture of 20,000x20,000: refused from its header, in little memory.
"$helper" white huge.png 20000
memory=1000000 # KiB
if grep -q __asan_init "$brace"; then memory=unlimited; fi # its shadow is larger than that
refuse_huge() {
    last="$*"
    checks=$((checks + 1))
    (ulimit -v $memory; "$brace" "$@" >out 2>err </dev/null)
    [ $? -eq 1 ] || bad 'it was not refused'
    says 'huge.png'
    says '20000 x 20000'
    says '64 million'
}
refuse_huge simulate huge.png -o x "${small[@]}"
mkdir screens
cp "$root"/data/screens/00000[0-5]*.webp screens
cp huge.png screens
build=(dataset build --screens screens --train 2 --test 1 "${small[@]}")
refuse_huge "${build[@]}" -o x

# Bad screens are found before anything is built, and named.
echo 'not a picture' >screens/huge.png
run 1 "${build[@]}" -o x; says 'screens/huge.png'; says 'not a PNG'
: >screens/empty.jpg
head -c 2000 "$good" >screens/cut.webp
run 1 "${build[@]}" -o x; says 'screens/cut.webp'; says 'and 2 more screens'
mkdir screens/folder.png
rm screens/{huge.png,empty.jpg,cut.webp}
run 1 "${build[@]}" -o x; says 'folder.png'
rmdir screens/folder.png
ln -s nowhere.png screens/link.png
run 1 "${build[@]}" -o x; says 'link.png'
rm screens/link.png
[ ! -e x ] || leaves x
run 0 "${build[@]}" -o set; silent
run 0 dataset verify set; prints '3 samples, 0 bad'

# Nothing to tell the splits apart by.
mkdir same
cp one.png same
run 1 dataset build --screens same --train 1 --test 1 -o x; says 'only one'
"$helper" white same/two.png 50
run 1 dataset build --screens same --train 1 --test 1 -o x; says 'look alike'
run 0 dataset build --screens same --train 1 --test 0 "${small[@]}" -o alone

# Folders and files that are not there, or must not be read or written.
run 1 dataset build --screens nowhere -o x; says 'nowhere'; says 'No such file'
run 1 dataset build --screens one.png -o x; says 'one.png'
run 1 dataset build --priors nowhere.json -o x; says 'nowhere.json'
run 1 "${build[@]}" -o one.png/set; says 'one.png: it is a file'
run 1 "${build[@]}" -o /proc/set; says '/proc/set'
run 1 simulate one.png -o one.png "${small[@]}"; says 'one.png'
BRACE_DATA=/nowhere run 1 simulate one.png -o x --display steady -q; says '/nowhere'; says 'BRACE_DATA'
BRACE_DATA=/nowhere run 1 dataset build -o x -q; says '/nowhere'; says 'BRACE_DATA'
if [ "$(id -u)" -ne 0 ]; then
    chmod 000 screens
    run 1 "${build[@]}" -o x; says 'screens'; says 'Permission denied'
    chmod 755 screens
    mkdir -m 555 locked
    run 1 "${build[@]}" -o locked/x; says 'locked/x'
    chmod 000 one.png
    run 1 simulate one.png -o x -q; says 'one.png'
    chmod 644 one.png
fi
[ ! -e x ] || leaves x

# JSON: file, line and key.
wrong() { # wrong TEXT LINE_AND_KEY: of a display
    printf '%b' "$1" >wrong.json
    run 1 simulate one.png -o x "${small[@]}" --display ./wrong.json
    says "wrong.json:$2"
}
wrong '{' '1: not valid JSON'
wrong '{"driver": "lcd_pwm",\n"frequency": 200,,\n"duty": 0.5}' '2: not valid JSON'
wrong '[]' '1: an object'
wrong '{"driver": "plasma"}' '1: driver: "plasma"'
wrong '{\n"driver": "lcd_pwm",\n"frequency": 1e9,\n"duty": 0.5}' '3: frequency: 1000000000'
wrong '{\n"driver": "lcd_pwm",\n"frequency": "fast",\n"duty": 0.5}' '3: frequency: a number is expected, not a string'
wrong '{\n"driver": "lcd_pwm",\n"frequency": 200}' '1: duty: is missing'
wrong '{\n"driver": "lcd_pwm",\n"frequency": 200, "duty": 0.5,\n\n"dutty": 1}' '5: dutty: is not known'
wrong '{\n"driver": "lcd_pwm", "frequency": 200, "duty": 0.5,\n"decay": [0,\n0, -1]}' '4: decay[2]'
wrong '{\n"driver": "lcd_pwm", "duty": 0.5,\n"duty": 0.4, "frequency": 200}' '3: not valid JSON: duplicate'
wrong '{\n"driver": "led_spwm", "refresh": 60, "bits": 14, "scan": 8,\n"subperiods": 33}' '3: subperiods: 33'
printf '\xef\xbb\xbf{"driver": "dc"}' >marked.json # as some editors save UTF-8
run 0 simulate one.png -o marked "${small[@]}" --display ./marked.json
mkdir folder.json
run 1 simulate one.png -o x --display ./folder.json; says 'folder.json'; says 'it is a folder'
head -c 5000000 /dev/zero >wrong.json
run 1 simulate one.png -o x --display ./wrong.json; says 'wrong.json'
printf '{"displays": {"crt_60": 1},\n"flicker_free": 0,\n"scene": {"iso": {"uniform": [100, "b"]}}}' >wrong.json
run 1 dataset build -o x --priors wrong.json; says 'wrong.json:3: scene.iso.uniform[1]'
[ ! -e x ] || leaves x

# A full disk, or as much as one file may have: what was whole stays, nothing else; then the rest, the same as elsewhere.
full() { # full FOLDER COMMAND
    is "$2, full disk" "$(cat code) $(find "$1" -name '.*' | wc -l)" '1 0'
    says 'cannot write'
}
(ulimit -f 4; trap '' XFSZ; "$brace" "${build[@]}" -o limit 2>err >out; echo $? >code)
full limit build
(ulimit -f 4; trap '' XFSZ; "$brace" simulate "$good" "${small[@]}" -o limited 2>err >out; echo $? >code)
full limited simulate
leaves limited
run 0 "${build[@]}" -o limit
ok 'the set is the same' diff -r set limit
if unshare -rm true 2>/dev/null; then
    mkdir disk
    unshare -rm bash -c "mount -t tmpfs -o size=100k none disk && { '$brace' ${build[*]} -o disk/set 2>err >out; echo \$? >code
        cp -r disk/set kept; }"
    full kept build
    for sample in kept/*/*/; do [ ! -d "$sample" ] || is "files of $sample" "$(ls -A "$sample" | wc -l)" 7; done
    run 0 "${build[@]}" -o kept
    ok 'the set is the same' diff -r set kept
fi
finish
