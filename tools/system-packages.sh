#!/bin/sh
# Install the few system packages that no wheel brings, or say how.
#
#   ld           PoCL links each kernel with it (Debian: binutils); nothing casts without
#   libEGL.so.1  headless OpenGL and its software driver; without it relighting uses NumPy
#
# Installs only as root with apt-get. Elsewhere it prints the command and goes on: the package
# itself explains what is missing when it is needed.
set -u
packages=""
command -v ld >/dev/null 2>&1 || packages="$packages binutils"
"$1" -c 'import ctypes; ctypes.CDLL("libEGL.so.1")' >/dev/null 2>&1 ||
    packages="$packages libegl1 libgl1-mesa-dri"
[ -n "$packages" ] || exit 0
if command -v apt-get >/dev/null 2>&1 && [ "$(id -u)" = 0 ]; then
    echo "installing system packages:$packages"
    apt-get update -qq >/dev/null 2>&1
    # shellcheck disable=SC2086
    DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends $packages \
        >/dev/null 2>&1 && exit 0
fi
echo "system packages are missing; please run: sudo apt-get install$packages" >&2
