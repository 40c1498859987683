#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# brace simulate: usage, one capture from a screen to a merge, the same bytes again, and what goes wrong.
source "$(dirname "$0")/lib.sh"
export BRACE_DATA=$root/data
screen=$root/data/screens/000009_static.webp
small=(--size 160x120 --quiet)

run 0 simulate --help; prints 'SCREEN... -o DIR'
run 0 help simulate; prints '--display'
run 2 simulate; says 'no picture of a screen'
run 2 simulate "$screen"; says '-o DIR'
run 2 simulate "$screen" -o x --size 160; says '--size 160'
run 2 simulate "$screen" -o x --size 160x120px; says '--size'
run 2 simulate "$screen" -o x --time 0; says '--time 0'
run 2 simulate "$screen" -o x --sheet sheet.doc; says 'sheet.doc'
cp "$screen" page.webp
run 2 simulate "$screen" page.webp -o x --sheet ./page.webp; says 'one of the screens'; ok 'the screen' cmp "$screen" page.webp
run 2 simulate "$screen" -o x --count 0
run 2 simulate "$screen" -o x --iso nan
absent x

run 0 simulate "$screen" -o one "${small[@]}" --time 1/640 --level 0.4 --sheet sheet.png --explain
leaves one 000000
leaves one/000000 frame_1.dng frame_2.dng frame_3.dng frame_4.dng frame_5.dng gt.dng meta.json
cp out explained.json
is 'seed' "$(json one/000000/meta.json scene seed)" 1
is 'explained' "$(json explained.json display name)" "$(json one/000000/meta.json display name)"
is 'screen' "$(json one/000000/meta.json screen)" 000009_static.webp
exists sheet.png
run 0 info one/000000/frame_*.dng --json --quiet
cp out info.json
# Four times the time from frame to frame, in the order in which a bracket is sorted.
for i in 0 1 2 3; do
    ok "step $i" awk -v a="$(json info.json frames $i exposure_time)" -v b="$(json info.json frames $((i + 1)) exposure_time)" \
        'BEGIN { exit !(b / a > 3.99 && b / a < 4.01) }'
done
run 0 restore one/000000/frame_*.dng -o merged.dng --quiet; exists merged.dng
run 0 dataset verify one; prints '1 samples, 0 bad'
run 1 simulate "$screen" -o one "${small[@]}"; says 'is there already'

# The seed decides, the number of threads doesn't.
run 0 simulate "$screen" -o again "${small[@]}" --time 1/640 --level 0.4 --threads 1
run 0 simulate "$screen" -o other "${small[@]}" --time 1/640 --level 0.4 --seed 2 --threads 2
run 0 simulate "$screen" -o third "${small[@]}" --time 1/640 --level 0.4 --threads 2
for f in frame_1 frame_3 frame_5 gt; do
    ok "the same $f again" cmp one/000000/$f.dng again/000000/$f.dng
    ok "the same $f with other threads" cmp one/000000/$f.dng third/000000/$f.dng
    checks=$((checks + 1))
    ! cmp -s one/000000/$f.dng other/000000/$f.dng || bad "another seed gives the same $f"
done
run 0 simulate "$screen" "$screen" -o many "${small[@]}" --count 2 --field --off tremor
leaves many 000000 000001 000002 000003
# In the field the truth is a photograph; the exact one lies beside it.
leaves many/000001 frame_1.dng frame_2.dng frame_3.dng frame_4.dng frame_5.dng gt.dng gt_exact.dng meta.json
run 0 dataset verify many; prints '4 samples, 0 bad'
printf 'x' >>many/000002/gt_exact.dng
run 1 dataset verify many; prints '000002: gt_exact.dng has'
rm many/000003/gt_exact.dng
run 1 dataset verify many; prints '000003: gt_exact.dng is missing'
for d in steady monitor_lcd_200 phone_oled_120_480 led_wall_1920_32 dlp_120 crt_60; do
    run 0 simulate "$screen" -o shows_$d "${small[@]}" --display $d --camera phone_fast --off noise,psf,glare,vignetting,distortion
    silent
done

# An earlier sample's meta.json gives that sample again, byte for byte: scene, display and camera.
again()
{
    run 0 simulate "$screen" -o "$1" "${small[@]:2}" --scene "$2"
    for f in "${2%/*}"/*.dng; do
        ok "$1: the same ${f##*/} from $2" cmp "$f" "$1/000000/${f##*/}"
    done
}
again scene_1 many/000001/meta.json
for d in laptop_miniled_15000 led_wall_1920_8 hub75_120_planes crt_85; do
    run 0 simulate "$screen" -o from_$d --size 64x48 --quiet --display "$d" --camera camera_slow --seed 9007199254740991 --set sensor_nonuniformity=0.01
    again to_$d from_$d/000000/meta.json
done
for c in phone_slow canon_r5; do
    run 0 simulate "$screen" -o with_$c --size 64x48 --quiet --camera "$c" --set frames=3 --set seed=18446744073709551615
    leaves with_$c/000000 frame_1.dng frame_2.dng frame_3.dng gt.dng meta.json
    again back_$c with_$c/000000/meta.json
done
# A scene alone: the rest is sampled from its seed; options come after it.
echo '{"seed": 4, "psf": 1.25, "frames": 3, "reference_time": 0.002}' >scene.json
run 0 simulate "$screen" -o alone "${small[@]}" --scene scene.json --set psf=1.5 --off glare,pose
is 'psf' "$(json alone/000000/meta.json scene psf)" 1.5
is 'seed' "$(json alone/000000/meta.json scene seed)" 4
is 'glare' "$(json alone/000000/meta.json scene glare)" 0
is 'rotation_x' "$(json alone/000000/meta.json scene rotation_x)" 0
is 'reference_time' "$(json alone/000000/meta.json scene reference_time)" 0.002
run 0 simulate --list; prints 'reference_time'; prints '1e-06 to 10'; prints 'panel_nonuniformity'

# Mistakes.
run 2 simulate "$screen" -o x --set psf=11; says 'psf: 11 is out of range 0 to 10 pixels'
run 2 simulate "$screen" -o x --set blur=1; says 'blur is no quantity of a scene; there are seed'
run 2 simulate "$screen" -o x --set psf; says 'no NAME=VALUE'
run 2 simulate "$screen" -o x --off noise,lens; says '"lens" is no effect; there are pose, tremor'
run 1 simulate "$screen" -o x --scene nowhere.json; says 'nowhere.json'
printf '{"scene": {"psf": 0.5,\n"glare": 2}}' >bad.json
run 1 simulate "$screen" -o x --scene bad.json; says 'bad.json:2: scene.glare: 2 is out of range 0 to 1'
printf '{"seed": 1, "blur": 3}' >bad.json
run 1 simulate "$screen" -o x --scene bad.json; says 'blur'
printf '{"supersample": 3}' >bad.json
run 1 simulate "$screen" -o x --scene bad.json; says '1, 2 or 4'
printf '{"scene": 3}' >bad.json
run 1 simulate "$screen" -o x --scene bad.json; says 'scene'
printf '{"scene": {}, "display": {"driver": "warp"}}' >bad.json
run 1 simulate "$screen" -o x --scene bad.json; says 'display in bad.json'
absent x
run 1 simulate nowhere.png -o x -q; says 'nowhere.png'; says 'no such file'
run 1 simulate "$screen" -o x --display plasma -q; says 'plasma'; says 'led_wall_3840_16'
run 1 simulate "$screen" -o x --camera box -q; says 'box'; says 'phone_median'
run 1 simulate "$screen" -o x --size 8x8 -q; says 'width: 8 is out of range'
run 1 simulate "$screen" -o x --time 1000 -q; says 'out of range'
echo '{"driver": "oled_pwm", "refresh": 60,
"pulses": 0}' >bad.json
run 1 simulate "$screen" -o x --display ./bad.json -q; says 'bad.json:2: pulses: 0'
echo '{"make": "A", "model": "B",' >bad.json
run 1 simulate "$screen" -o x --camera ./bad.json -q; says 'bad.json'
sed 's/"readout": [^,]*/"readout": -1/' "$root/data/cameras/phone_fast.json" >bad.json
run 1 simulate "$screen" -o x --camera ./bad.json -q; says 'readout'; says 'out of range'
echo 'not a picture' >text.png
run 1 simulate text.png -o x -q; says 'text.png'
run 1 simulate "$screen" -o text.png -q; says 'text.png'
# A screen larger than any display: refused from its header.
printf '\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x4e\x20\0\0\x4e\x20\x01\0\0\0\0\x5f\x4e\xdb\x91' >huge.png
run 1 simulate huge.png -o x -q; says 'huge.png'
[ ! -e x ] || leaves x

# Stopped: what is there is complete, and nothing else is.
got=$("$helper" stop stopped+100 INT "$brace" simulate "$screen" -o stopped --count 500 --size 320x240 -q 2>err)
last='simulate, stopped'
is 'exit code' "$got" 130
says 'stopped'
ok 'something was made' test -d stopped
for sample in stopped/*/; do [ ! -d "$sample" ] || is "files of $sample" "$(ls -A "$sample" | wc -l)" 7; done
is 'left over' "$(ls -A stopped | grep -vc '^[0-9]*$')" 0

# A full disk leaves no half sample.
if [ -w /dev/shm ] && command -v unshare >/dev/null && unshare -rm true 2>/dev/null; then
    mkdir -p disk
    got=$(unshare -rm bash -c "mount -t tmpfs -o size=300k none disk && '$brace' simulate '$screen' -o disk/s -q --size 320x240 2>err; echo \$?; ls -A disk/s | wc -l" | tr '\n' ' ')
    last='simulate onto a full disk'
    is 'exit code and samples on a full disk' "$got" '1 0 '
    says 'cannot write'
fi
finish
