#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# A full disk: every format says so, and nothing is left behind.
source "$(dirname "$0")/lib.sh"
make_small
[ -e /dev/full ] || exit 77
for format in dng tif png jpg webp; do
    run 1 restore small -o /dev/full --format $format
    says '/dev/full'
    says 'o space left'
done
is '/dev/full is still a device' "$(test -c /dev/full && echo yes)" yes

# The same for what goes to stdout.
"$brace" info small >/dev/full 2>err; is 'info' $? 1; says 'No space left'
"$brace" info --json small >/dev/full 2>err; is 'info --json' $? 1
"$brace" restore small -q --json -o x.png >/dev/full 2>err; is 'restore --json' $? 1

# A limit on file size: the signal is turned into an error, the old file stays.
echo old >keep.tif
(ulimit -f 8; trap '' XFSZ; "$brace" restore small -q -o keep.tif) 2>err >out
is 'file size limit' $? 1
says 'keep.tif'
is 'the old file' "$(cat keep.tif)" old
leaves . small x.png keep.tif out err
finish
