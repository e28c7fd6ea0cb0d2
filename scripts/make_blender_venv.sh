#!/usr/bin/env bash
# Makes build/blender, an environment with Blender as a Python module (bpy, about 900 MB), for make
# test-blender. An existing environment is kept.
set -euo pipefail
cd "$(dirname "$0")/.."

venv=build/blender
if ! "$venv/bin/python" -c 'import bpy' >/dev/null 2>&1; then
    python=$(scripts/find_python.sh)
    "$python" -m venv --clear "$venv"
    "$venv/bin/python" -m pip install --quiet "bpy>=4.5,<6" || {
        echo "bpy cannot be installed for $("$python" --version); tests of Blender are skipped." >&2
    }
fi
