#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Makes the demo bracket and the pictures of the documentation anew, out of the
# simulator and data/screens. Needs a build and python3.
# Usage: scripts/pictures.sh [BUILD]
set -euo pipefail
cd "$(dirname "$0")/.."
build=${1:-build/release}
brace=$build/src/cli/brace
export BRACE_DATA=$PWD/data
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# ---- the demo: a LED wall whose modules are out of step ----
"$brace" simulate data/screens/000010_static.webp -o "$work/demo" --quiet --display led_wall_1920_8 --time 1/1600 \
    --iso 100 --level 0.7 --seed 2 --size 768x576 --distance 0.75 --set rotation_x=0.03 --set rotation_y=0.08 \
    --set rotation_z=-0.02 --set translation_x=0.02 --set translation_y=0
cp "$work"/demo/000000/frame_?.dng data/demo/

# ---- before and after ----
pair() { # NAME FRAMES...
    local name=$1
    shift
    "$brace" restore "$@" --quiet -o "$work/after.png"
    "$brace" restore "$@" --quiet --method reference -o "$work/before.png"
    "$build/bench/side_by_side" "$work/before.png" "$work/after.png" "docs/images/$name.jpg"
}
pair before_after_led data/demo/frame_?.dng
"$brace" simulate data/screens/000012_web.webp -o "$work/page" --quiet --display phone_oled_120_360 --time 1/500 \
    --iso 100 --level 0.5 --seed 6 --size 768x576 --distance 0.8 --set rotation_x=-0.04 --set rotation_y=-0.1 \
    --set rotation_z=0.03 --set translation_x=0 --set translation_y=0
pair before_after "$work"/page/000000/frame_?.dng

# ---- sheets: what banding looks like on real screens ----
sheet() { # NAME SCREEN DISPLAY TIME LEVEL [OPTION...]
    local name=$1 screen=$2 display=$3 time=$4 level=$5
    shift 5
    "$brace" simulate "$screen" -o "$work/$name" --quiet --display "$display" --time "$time" --level "$level" \
        --iso 100 --seed 3 --size 768x576 --sheet "docs/images/sheet_$name.jpg" "$@"
}
sheet led data/screens/000009_static.webp led_wall_3840_32 1/1600 0.8 --distance 0.9
sheet oled data/screens/000012_web.webp phone_oled_120_480 1/500 0.6 --distance 0.9
sheet lcd data/screens/000013_UI.webp monitor_lcd_240 1/1000 0.6 --distance 0.9

# ---- sheets: its forms one by one, on ramps, as in the paper's figure of them ----
python3 - "$work" <<'PYTHON'
import struct, sys, zlib

def png(path, width, height, pixel):
    rows = b"".join(b"\0" + b"".join(bytes(pixel(x / (width - 1))) for x in range(width)) for _ in range(height))
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    with open(path, "wb") as out:
        out.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)) +
                  chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))

def linear(share, colour):  # the share of the light, on the sRGB curve
    return [round(255 * (12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055))
            for v in (share * c for c in colour)]

png(sys.argv[1] + "/grey.png", 960, 720, lambda u: linear(u, (1, 1, 1)))
png(sys.argv[1] + "/orange.png", 960, 720, lambda u: linear(u, (1, 0.216, 0.02)))
png(sys.argv[1] + "/flat.png", 960, 720, lambda u: linear(0.5, (1, 1, 1)))
PYTHON
wall() { # FILE KEYS: eight inner cycles of whole units
    printf '{"driver": "led_spwm", "family": "led_wall", "refresh": 120, "subperiods": 8, "bits": 12, "unit": 512, %s}\n' \
        "$2" >"$work/$1.json"
}
wall plain '"scan": 1, "blanking": 0'
wall margin '"scan": 1, "blanking": 0.12'
wall tiles '"scan": 1, "blanking": 0, "tile": [160, 144], "tile_phase": 0.1'
form() { # NAME SCREEN DISPLAY TIME
    sheet "$1" "$work/$2.png" "$3" "$4" 0.8 --off all --set distance=1 --set supersample=2 --set noise=0
}
form typical flat monitor_lcd_240 1/2000
form brightness grey "$work/plain.json" 1/4000
form color orange "$work/plain.json" 1/4000
form compound grey "$work/margin.json" 1/4000
form jagged grey "$work/tiles.json" 1/4000
