#!/usr/bin/env bash
# Writes requirements.lock: one version of every dependency for all Pythons and platforms, with
# hashes, and without the address of any registry (docs/adr/0004). Arguments go to uv: --upgrade
# selects the newest versions.
set -euo pipefail
cd "$(dirname "$0")/.."

tool=build/lock
python=$(scripts/find_python.sh) || { echo "Python 3.11 or newer with venv is needed." >&2; exit 1; }
[ -x "$tool/bin/uv" ] || { "$python" -m venv "$tool" && "$tool/bin/python" -m pip install --quiet 'uv>=0.9,<1'; }

draft=build/requirements.lock
[ ! -f requirements.lock ] || cp requirements.lock "$draft"
"$tool/bin/uv" pip compile --quiet --universal --fork-strategy fewest --python-version 3.11 \
    --extra cluster --extra dev --extra docs --extra draco --extra notebook --generate-hashes --no-header --no-emit-index-url --no-emit-find-links \
    --output-file "$draft" "$@" pyproject.toml

if grep -nE '://|@ *file|(^|[ =])/' "$draft"; then
    echo "The lines above name a host or a path; requirements.lock is left as it was." >&2
    exit 1
fi
mv "$draft" requirements.lock
