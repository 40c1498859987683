#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Other people's programs read our DNGs: exiftool finds no error, dcraw and
# LibRaw see the colours of the input. Skipped where these are not installed.
source "$(dirname "$0")/lib.sh"
for tool in exiftool dcraw dcraw_emu raw-identify; do
    command -v $tool >/dev/null || { echo "$tool is not installed"; exit 77; }
done
demo=("$root"/data/demo/frame_*.dng)
run 0 restore "${demo[@]}" -q -o merged.dng
run 0 restore "${demo[@]}" -q --method reference -o reference.dng
mkdir turned
for i in 1 2 3; do "$helper" edit "$root/data/demo/frame_$i.dng" turned/$i.dng orientation=8 crop=1,1,301,201; done
run 0 restore turned -q -o turned.dng

for file in merged.dng reference.dng turned.dng; do
    last="exiftool -validate $file"
    exiftool -validate -warning -error -a -s "$file" >report 2>err
    is "exiftool's exit code of $file" $? 0; exists report
    is "what exiftool says of $file" "$(grep -cE '^(Error|Warning) ' report)" 0
    [ "$(grep -cE '^(Error|Warning) ' report)" -eq 0 ] || cat report
done

# The metadata of the input is there.
for tag in Make Model UniqueCameraModel ExposureTime ISO FNumber FocalLength DateTimeOriginal SubSecTimeOriginal \
    BlackLevel WhiteLevel ColorMatrix1 CalibrationIlluminant1 AsShotNeutral NoiseProfile CFAPattern2 Orientation \
    BaselineExposure; do
    want=$(exiftool -s3 -n "-$tag" "${demo[2]}"); ok "$tag is there" test -n "$want"
    is "$tag" "$(exiftool -s3 -n "-$tag" merged.dng)" "$want"
done

# within A B PERCENT: three means each
within() {
    awk -v a="$1" -v b="$2" -v limit="$3" 'BEGIN {
        n = split(a, x); if (n != 3 || split(b, y) != 3) exit 1
        for (i = 1; i <= 3; i++) { d = x[i] - y[i]; if (d < 0) d = -d; if (y[i] <= 0 || d > limit / 100 * y[i]) exit 1 }
    }'
}
# dcraw and LibRaw's dcraw_emu, linear, camera white balance, sRGB, no automatic
# brightness (-c 0: LibRaw otherwise takes the brightest pixel for white).
for developer in dcraw dcraw_emu; do
    for file in "${demo[2]}" reference.dng merged.dng; do
        cp "$file" in.dng
        if [ $developer = dcraw ]; then
            dcraw -c -4 -w -o 1 in.dng >in.ppm 2>err
        else
            dcraw_emu -4 -w -o 1 -W -c 0 in.dng >/dev/null 2>err
            mv in.dng.ppm in.ppm
        fi
        last="$developer $file"
        m=$("$helper" mean in.ppm)
        case $file in
            reference.dng)
                ok "$developer: mean '$m' of our DNG against '$input'" within "$m" "$input" 1 ;;
            merged.dng)
                # Without its banding the picture may be a little darker or brighter.
                ok "$developer: mean '$m' of the restored DNG against '$input'" within "$m" "$input" 6 ;;
            *) input=$m ;;
        esac
    done
    cp turned.dng in.dng
    if [ $developer = dcraw ]; then
        dcraw -c -4 -w turned.dng >in.ppm
    else
        dcraw_emu -4 -w in.dng >/dev/null && mv in.dng.ppm in.ppm
    fi
    is "$developer turns" "$(sed -n 2p in.ppm | head -c 7)" '201 301'
    if [ $developer = dcraw ]; then
        ok 'dcraw finds the preview' sh -c 'dcraw -e -c merged.dng | head -c 2 | od -An -tx1 | grep -q "ff d8"'
    fi
done
if command -v raw-identify >/dev/null; then
    last='raw-identify merged.dng'
    raw-identify -v merged.dng >report 2>&1
    ok 'raw-identify reads it' grep -q 'Median phone' report
fi
finish
