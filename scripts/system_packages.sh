#!/usr/bin/env bash
# Checks that the system has the software that pip cannot install: Python with venv, an EGL/OpenGL
# driver, an LLVM for Dr.Jit, and the libatomic to which Dr.Jit's wheel links. Installs missing
# packages by apt-get if permitted; otherwise names them and stops.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/steps.sh

missing() {
    local python
    if ! python=$(scripts/find_python.sh); then
        echo python
        # Any Python 3 can run the probe, so that all missing packages are installed in one run.
        python=$(command -v python3) || { printf '%s\n' atomic opengl llvm; return; }
    fi
    "$python" scripts/probe_system.py
}

# The newest LLVM of this distribution release that was tested with Dr.Jit.
apt_llvm() {
    for version in 19 18 17; do
        if [[ $(apt-cache policy "libllvm$version") == *"Candidate: "[0-9]* ]]; then
            echo "libllvm$version"
            return
        fi
    done
    echo libllvm19
}

apt_packages() {
    for what in "$@"; do
        case $what in
            python) echo python3 python3-venv ;;
            atomic) echo libatomic1 ;;
            opengl) echo libegl1 libgl1 libegl-mesa0 libgl1-mesa-dri ;;
            llvm) apt_llvm ;;
        esac
    done
}

name_packages() {
    cat >&2 <<END
xfrustum needs these from the system, and does not find them: $*
  python  Python 3.11 or newer with venv (or set PYTHON to one)
  atomic  the compiler's libatomic.so.1, which Dr.Jit links to
  opengl  an EGL/OpenGL driver that works without a display, Mesa's or a graphics card's
  llvm    an LLVM library, version 17 to 19 (or set DRJIT_LIBLLVM_PATH to one)
Install them, then run make again; as root on
  Debian, Ubuntu:  apt-get install python3 python3-venv libatomic1 libegl1 libgl1 libegl-mesa0 \\
                                   libgl1-mesa-dri libllvm19
  Fedora:          dnf install python3 libatomic mesa-libEGL mesa-libGL mesa-dri-drivers llvm19-libs
  Arch:            pacman -S python gcc-libs mesa libglvnd llvm19-libs
END
    exit 1
}

lacking=$(missing)
[ -n "$lacking" ] || exit 0

as_root=()
if [ "$(id -u)" -ne 0 ]; then
    as_root=(sudo -n)
    sudo -n true 2>/dev/null || name_packages $lacking
fi
command -v apt-get >/dev/null || name_packages $lacking

step "list of the distribution's packages" "${as_root[@]}" apt-get update || name_packages $lacking
packages=$(apt_packages $lacking)
step "$(echo $packages)" "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
    apt-get install -y --no-install-recommends $packages || name_packages $lacking

lacking=$(missing)
[ -z "$lacking" ] || name_packages $lacking
