#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Opens the reports in headless Chromium (tests/browser); fails where `make check` skips it. BRACE_SHOTS=FOLDER keeps
# screenshots.
set -euo pipefail
cd "$(dirname "$0")/.."
dir=build/check
[ -f $dir/build.ninja ] || meson setup $dir -Dwerror=true
ninja -C $dir -j "$(nproc)" --quiet
BRACE_NEED_BROWSER=1 meson test -C $dir --no-rebuild --suite browser --print-errorlogs
