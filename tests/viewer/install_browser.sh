#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Installs Debian's chromium where there is no such browser, for the tests of the viewer's page.
# Where that cannot be, it says why and ends well: those tests are then skipped.

BROWSERS="chromium chromium-browser google-chrome google-chrome-stable"
PACKAGES="chromium fonts-dejavu-core"

is_there() {
    for browser in $BROWSERS; do
        command -v "$browser" >/dev/null 2>&1 && return 0
    done
    return 1
}

give_up() {
    echo "no browser: $1; the tests of the viewer's page are skipped"
    exit 0
}

is_there && exit 0
command -v apt-get >/dev/null 2>&1 || give_up "there is no apt-get; install Chromium by hand"
if [ "$(id -u)" = 0 ]; then
    as_root=""
elif sudo -n true 2>/dev/null; then
    as_root="sudo -n"
else
    give_up "only root may install it: apt-get install $PACKAGES"
fi

echo "installing $PACKAGES, for the tests of the viewer's page"
apt="env DEBIAN_FRONTEND=noninteractive apt-get -qq -o Acquire::Retries=2 -o Acquire::http::Timeout=20"
log=$(mktemp) || give_up "no temporary file can be written"
trap 'rm -f "$log"' EXIT
# Each for at most some minutes, with the known lists of packages if there are no newer ones.
timeout 120 $as_root $apt update >"$log" 2>&1 || echo "apt-get update failed: $(tail -n 1 "$log")"
timeout 300 $as_root $apt install -y --no-install-recommends $PACKAGES >"$log" 2>&1 </dev/null ||
    give_up "apt-get install $PACKAGES failed: $(tail -n 1 "$log")"
is_there || give_up "apt-get installed $PACKAGES, but there is none of: $BROWSERS"
