#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# brace metrics: two pictures, two folders, RAW files, brackets, tables, bad input.
source "$(dirname "$0")/lib.sh"
unset BRACE_WEIGHTS
make_small
mkdir pred gt
"$brace" restore small/frame_*.dng -q -o pred/a.png -o a.dng -o a.tif --bits 16 || exit 1
"$brace" restore small/frame_*.dng -q -m reference -o pred/b.jpg -o b.dng || exit 1
cp pred/a.png gt/a.png
cp a.tif gt/b.tif
cp a.tif 'gt/alone, "here".tif'

# Two files.
run 0 metrics pred/a.png gt/a.png
prints PSNR; prints SSIM; prints MS-SWD; prints inf; prints 1.0000; prints 0.0000; says 'weights are not part of BRACE'
run 0 metrics pred/b.jpg a.tif -q --json; cp out m.json
is count "$(json m.json pairs count)" 1
is name "$(json m.json pairs 0 name)" b
is identical "$(json m.json pairs 0 metrics identical)" false
ok psnr json m.json pairs 0 metrics psnr
ok mean json m.json summary ms-swd mean
is null "$(json m.json pairs 0 metrics sfc 2>/dev/null)" ''
run 0 metrics pred/a.png pred/a.png --json; cp out m.json
is infinite "$(json m.json pairs 0 metrics psnr)" null
is identical "$(json m.json pairs 0 metrics identical)" true
run 0 metrics pred/b.jpg a.tif -m ssim -q; prints SSIM
ok 'only SSIM' bash -c '! grep -q PSNR out'

# The same numbers with any number of threads.
run 0 metrics pred/b.jpg a.tif -q --json -t 1; cp out one.json
run 0 metrics pred/b.jpg a.tif -q --json -t 3; cmp -s one.json out || bad 'threads change the numbers'

# RAW files: both with the truth's colours; SFC along the banding of the shortest frame.
run 0 metrics b.dng a.dng --bracket small/frame_*.dng --json -q; cp out m.json
ok sfc json m.json pairs 0 metrics sfc
ok direction json m.json pairs 0 metrics sfc_parts direction
first=$(json m.json pairs 0 metrics sfc)
is 'mean of one' "$(json m.json summary sfc_parts d_ratio mean)" "$(json m.json pairs 0 metrics sfc_parts d_ratio)"
is 'deviation of one' "$(json m.json summary sfc_parts delta_profile deviation)" 0
run 0 metrics b.dng a.dng --bracket small -m sfc -q --csv sfc.csv; prints 'D_profile'
ok 'parts in CSV' grep -q 'sfc,sfc_d_ratio,sfc_d_profile,sfc_delta_ratio,sfc_delta_profile' sfc.csv
run 0 metrics b.dng a.dng --bracket small --json -q; cp out m.json; is folder "$(json m.json pairs 0 metrics sfc)" "$first"
run 0 metrics b.dng a.dng -b small/frame_1.dng --json -q; cp out m.json; is shortest "$(json m.json pairs 0 metrics sfc)" "$first"
"$helper" edit small/frame_2.dng timeless.dng time=0
run 1 metrics b.dng a.dng -b small/frame_1.dng timeless.dng -m psnr,sfc; says timeless.dng; prints PSNR
run 2 metrics b.dng a.dng -m sfc; says '--bracket'

# Two folders.
run 0 metrics pred gt --csv m.csv
prints mean; prints deviation; says 'alone'; says 'no partner'
is lines "$(wc -l <m.csv)" 5
is header "$(head -1 m.csv | tr -d '\r')" name,pred,gt,psnr,ssim,ms-swd
is first "$(sed -n 2p m.csv | tr -d '\r')" a,pred/a.png,gt/a.png,inf,1,0
mkdir -p brackets/a brackets/b
cp small/*.dng brackets/a; cp small/frame_1.dng brackets/b
run 0 metrics pred gt -b brackets --json -q; cp out m.json
is pairs "$(json m.json summary sfc count)" 2
is unmatched "$(json m.json unmatched count)" 1
rm -r brackets/b
run 1 metrics pred gt -b brackets; says "'b'"
run 2 metrics pred gt -b brackets small
cp pred/a.png pred/a.webp 2>/dev/null; run 1 metrics pred gt; says 'which one is it'; rm pred/a.webp
mkdir empty; run 1 metrics pred empty; says 'no picture'
run 1 metrics pred gt/a.png; says 'is a folder'

# Weights: what is missing is said, with where it is; by default it is left out.
run 1 metrics pred/a.png gt/a.png -m lpips
says https://download.pytorch.org/models/alexnet-owt-7be5be79.pth; says lpips/weights/v0.1/alex.pth; says BRACE_WEIGHTS
run 1 metrics pred/a.png gt/a.png -m dists -w empty; says vgg16-397923af.pth; says 'the folder empty'
run 0 metrics pred/a.png gt/a.png -w empty; says 'left out: lpips-alex needs two files'
BRACE_WEIGHTS=empty run 0 metrics pred/a.png gt/a.png; says 'left out: dists needs two files'
cp "$root/tests/nn/data/legacy.pth" empty/alex.pth
run 1 metrics pred/a.png gt/a.png -m lpips -w empty; says 'needs a file'
cp "$root/tests/nn/data/zip.pth" empty/alexnet-owt-7be5be79.pth
run 1 metrics pred/a.png gt/a.png -w empty; says features.0.weight
head -c 1000 "$root/tests/nn/data/zip.pth" >empty/alexnet-owt-7be5be79.pth
run 1 metrics pred/a.png gt/a.png -w empty --json; says 'cut off'; prints error

# Bad input: sizes, damage, one pixel, constant pictures.
"$brace" restore small/frame_*.dng -q -o big.png || exit 1
make_small other 100,100,96,96
"$brace" restore other/frame_*.dng -q -o small.png || exit 1
run 1 metrics big.png small.png; says '160 x 128'; says '96 x 96'
head -c 3000 pred/a.png >cut.png
run 1 metrics cut.png gt/a.png --json; says cut.png; cp out m.json; is null "$(json m.json pairs 0 metrics psnr)" null
run 1 metrics none.png gt/a.png; says none.png
run 1 metrics gt/a.png ''; says "''"
printf '\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\1\0\0\0\1\10\0\0\0\0\x3a\x7e\x9b\x55\0\0\0\nIDAT\x78\x9c\x63\x60\0\0\0\2\0\1\x48\xaf\xa4\x71\0\0\0\0IEND\xae\x42\x60\x82' >pixel.png
run 1 metrics pixel.png pixel.png --json; says 'too small'; cp out m.json
is ssim "$(json m.json pairs 0 metrics ssim)" null
is swd "$(json m.json pairs 0 metrics ms-swd)" 0
run 0 metrics pixel.png pixel.png -m psnr,ms-swd

# Usage.
run 2 metrics; says 'which pictures'
run 2 metrics a.png; says 'which pictures'
run 2 metrics a.png b.png c.png; says c.png
run 2 metrics a.png b.png -m psnr,simm; says "did you mean ssim"
run 2 metrics a.png b.png -m ''; says '--metrics'
run 0 metrics --help; prints '--bracket'; prints 'results/ truth/'
run 1 metrics pred gt --csv none/here.csv; says none/here.csv
finish
