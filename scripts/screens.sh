#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Collects some 2,500 screens of 1920x1080 for the simulator: wallpapers, games,
# interfaces, documents, web pages, spreadsheets, code, text, charts and test
# patterns, from Debian packages and drawn by itself.
#
# Usage: scripts/screens.sh FOLDER [--work FOLDER] [--jobs N] [--limit N] [CATEGORY ...]
#   --work   where packages and intermediate pictures are kept, 3 GB (default: FOLDER.work);
#            what is there from an interrupted run is used again
#   --limit  at most N screens of each category, to try it out
# The few that ship in data/screens are made by screens/shipped.py.
# Categories: art chart cjk code doc doc2 game pattern sheet static text UI web web2
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)

usage() {
    sed -n '3,14s/^# \{0,1\}//p' "$0"
    exit "$1"
}
out= work= jobs=$(nproc) limit=0 categories=()
while [ $# -gt 0 ]; do
    case $1 in
        -h | --help) usage 0 ;;
        --work | --jobs | --limit)
            [ $# -gt 1 ] || { echo "screens: $1 needs a value" >&2; exit 2; }
            declare "${1#--}=$2"
            shift
            ;;
        -*) echo "screens: there is no option $1" >&2; usage 2 >&2 ;;
        *) if [ -z "$out" ]; then out=$1; else categories+=("$1"); fi ;;
    esac
    shift
done
[ -n "$out" ] || usage 2 >&2
work=${work:-${out%/}.work}
mkdir -p "$work/debs" "$work/root" "$out"
work=$(cd "$work" && pwd)

tools=(python3 python3-pil python3-numpy poppler-utils chromium
    fonts-dejavu-core fonts-liberation fonts-wqy-zenhei fonts-ipafont-gothic)
content=(plasma-workspace-wallpapers gnome-backgrounds mate-backgrounds
    gimp-help-en gnome-user-docs debian-handbook gnuplot-doc r-doc-pdf
    games-thumbnails gcompris-qt-data wesnoth-1.16-data
    wesnoth-1.16-{did,dm,dw,ei,httt,l,low,nr,sof,sota,sotbe,thot,trow,tsg,ttb,utbs})

missing=()
for package in "${tools[@]}"; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q ' installed' || missing+=("$package")
done
as_root=()
[ "$(id -u)" -eq 0 ] || as_root=(sudo)
refreshed=
refresh() {
    if [ -z "$refreshed" ]; then
        "${as_root[@]}" apt-get update -q
        refreshed=1
    fi
}
if [ ${#missing[@]} -gt 0 ]; then
    echo "screens: installing ${missing[*]}"
    install=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends)
    "${install[@]}" "${missing[@]}" >/dev/null || { refresh; "${install[@]}" "${missing[@]}"; }
fi

# The packages with pictures are unpacked, not installed: the system stays as it is, needs no
# root for them, and a system that was told to leave out documentation has it nevertheless.
for package in "${content[@]}"; do
    [ ! -e "$work/root/.$package" ] || continue
    if ! ls "$work/debs/${package}"_*.deb >/dev/null 2>&1; then
        echo "screens: fetching $package"
        (cd "$work/debs" && apt-get download -q "$package" >/dev/null 2>&1) || {
            refresh
            (cd "$work/debs" && apt-get download -q "$package")
        }
    fi
    for deb in "$work/debs/${package}"_*.deb; do
        dpkg-deb -x "$deb" "$work/root"
    done
    touch "$work/root/.$package"
done

out=$(realpath "$out")
cd "$here/screens"
exec env PYTHONDONTWRITEBYTECODE=1 /usr/bin/python3 collect.py "$work/root" "$work" "$out" "$jobs" "$limit" \
    ${categories[@]+"${categories[@]}"}
