# SPDX-License-Identifier: BSD-3-Clause
# Sourced by the scripts beside it with a list of pinned packages of Debian 12: they are unpacked, not installed, in a
# temporary folder, which becomes the working directory and is removed at the end. Wants amd64, `apt-get update` done once,
# binutils and libc6-dev.
set -euo pipefail
here=$(mktemp -d)
trap 'rm -rf "$here"' EXIT
cd "$here"
apt-get -q -o APT::Sandbox::User=root download "$@" > log
for package in *.deb; do dpkg -x "$package" .; done
PATH=$here/usr/bin:$PATH
export LD_LIBRARY_PATH="$here/usr/lib/x86_64-linux-gnu"
