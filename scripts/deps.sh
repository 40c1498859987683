#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Installs the Debian packages that building and testing BRACE needs and that
# are missing. Uses sudo when not root. Does nothing when all are there.
# `deps.sh slow`: also what make check-slow needs: a browser for the reports, clang for fuzzing.
set -euo pipefail

packages=(
    # build
    gcc libc6-dev make meson ninja-build pkg-config
    g++ # for libstdc++, which libraw_r.pc asks for
    # libraries
    libraw-dev libtiff-dev libpng-dev libjpeg-dev libwebp-dev libjansson-dev zlib1g-dev libkissfft-dev
    libdnnl-dev # convolutions and products in f32
    libopenmpi-dev openmpi-bin # training by several processes
    libgphoto2-dev # tethered cameras
    # tests: cmocka, and other people's DNG readers to check ours against
    libcmocka-dev libimage-exiftool-perl dcraw libraw-bin
)
if [ "${1:-}" = slow ]; then
    packages+=(chromium nodejs clang libclang-rt-dev)
fi

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
    for tool in cc meson ninja pkg-config exiftool dcraw; do
        command -v "$tool" >/dev/null || missing_tools+=("$tool")
    done
    for library in libraw_r libtiff-4 libpng libjpeg libwebp jansson zlib kissfft-float cmocka; do
        pkg-config --exists "$library" 2>/dev/null || missing_tools+=("$library")
    done
    if [ -n "${missing_tools+x}" ]; then
        echo "deps: this is no Debian system; please install by hand: ${missing_tools[*]}" >&2
        exit 1
    fi
    exit 0
fi

missing=()
for package in "${packages[@]}"; do
    status=$(dpkg-query -W -f '${Status}' "$package" 2>/dev/null || true)
    [[ $status == *' installed' ]] || missing+=("$package")
done
[ ${#missing[@]} -gt 0 ] || exit 0

as_root=()
if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null; then
        echo "deps: these packages are missing: ${missing[*]}" >&2
        echo "deps: run as root: apt-get install ${missing[*]}" >&2
        exit 1
    fi
    as_root=(sudo)
fi

echo "deps: installing ${missing[*]}"
export DEBIAN_FRONTEND=noninteractive
install=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "${missing[@]}")
# The package lists of a fresh container are empty or old: refresh them when the first try fails.
"${install[@]}" >/dev/null 2>&1 || {
    "${as_root[@]}" apt-get update -q
    "${install[@]}"
}
