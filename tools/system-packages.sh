#!/bin/sh
# Install the few system packages that no wheel brings, or say how.
#
#   gcc, libc6-dev  PoCL links each kernel with ld, libgcc and libc
#   pocl-opencl-icd Debian's PoCL, where the wheel's cannot compile for this CPU
#   libegl1, libgl1, libgl1-mesa-dri
#                   headless OpenGL and its software driver; without it relighting uses NumPy
#   xvfb, xdotool, x11-utils
#                   a display and a hand for the viewer's tests; asked for as `… test`
#   chromium        draws the web pages in their tests; with these
#
# Installs only as root with apt-get. Elsewhere it prints the command and goes on: the package
# itself explains what is missing when it is needed.
set -u
python=$1
purpose=${2:-}

install() {
    if command -v apt-get >/dev/null 2>&1 && [ "$(id -u)" = 0 ]; then
        echo "installing system packages: $*"
        apt-get update -qq >/dev/null 2>&1
        DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends "$@" \
            >/dev/null 2>&1 && return 0
    fi
    echo "system packages are missing; please run: sudo apt-get install $*" >&2
    return 1
}

device_works() {
    "$python" -c 'from volspec._gpu.devices import choose_device; choose_device()' >/dev/null 2>&1
}

if ! device_works; then
    { command -v ld && ls /usr/lib*/gcc*/*/*/libgcc.a; } >/dev/null 2>&1 ||
        install gcc libc6-dev
    device_works || { install pocl-opencl-icd && device_works; } ||
        "$python" -m volspec doctor | grep '^missing' >&2
fi
set --
"$python" -c 'from volspec._gpu.opengl import headless_context; headless_context()' \
    >/dev/null 2>&1 || set -- libegl1 libgl1 libgl1-mesa-dri
if [ "$purpose" = test ]; then
    command -v Xvfb >/dev/null 2>&1 || set -- "$@" xvfb
    command -v xdotool >/dev/null 2>&1 || set -- "$@" xdotool
    command -v xprop >/dev/null 2>&1 || set -- "$@" x11-utils
    command -v chromium >/dev/null 2>&1 || set -- "$@" chromium
fi
[ $# = 0 ] || install "$@" || exit 0
