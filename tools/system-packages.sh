#!/bin/sh
# Install the few system packages that no wheel brings, or say how.
#
#   gcc, libc6-dev  PoCL links each kernel with ld, libgcc and libc; nothing casts without
#   libegl1, libgl1, libgl1-mesa-dri
#                   headless OpenGL and its software driver; without it relighting uses NumPy
#   xvfb, xdotool, x11-utils
#                   a display and a hand for the viewer's tests; asked for as `… test`
#   chromium        draws the web pages in their tests; with these
#
# Installs only as root with apt-get. Elsewhere it prints the command and goes on: the package
# itself explains what is missing when it is needed.
set -u
packages=""
"$1" -c 'import sys; from volspec._gpu.devices import missing_linker; sys.exit(bool(missing_linker()))' \
    >/dev/null 2>&1 || packages="$packages gcc libc6-dev"
"$1" -c 'from volspec._gpu.opengl import headless_context; headless_context()' \
    >/dev/null 2>&1 || packages="$packages libegl1 libgl1 libgl1-mesa-dri"
if [ "${2:-}" = test ]; then
    command -v Xvfb >/dev/null 2>&1 || packages="$packages xvfb"
    command -v xdotool >/dev/null 2>&1 || packages="$packages xdotool"
    command -v xprop >/dev/null 2>&1 || packages="$packages x11-utils"
    command -v chromium >/dev/null 2>&1 || packages="$packages chromium"
fi
[ -n "$packages" ] || exit 0
if command -v apt-get >/dev/null 2>&1 && [ "$(id -u)" = 0 ]; then
    echo "installing system packages:$packages"
    apt-get update -qq >/dev/null 2>&1
    # shellcheck disable=SC2086
    DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends $packages \
        >/dev/null 2>&1 && exit 0
fi
echo "system packages are missing; please run: sudo apt-get install$packages" >&2
