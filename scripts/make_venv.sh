#!/usr/bin/env bash
# Makes .venv with exactly the packages of requirements.lock and the project itself, editable.
# An environment that was made from the same lock file is kept.
set -euo pipefail
cd "$(dirname "$0")/.."

venv=.venv
made_from=$venv/requirements.lock

if ! { cmp -s requirements.lock "$made_from" && "$venv/bin/python" -m pip --version; } >/dev/null 2>&1; then
    python=$(scripts/find_python.sh) || {
        echo "Python 3.11 or newer with venv is needed; install one, or set PYTHON to its path." >&2
        exit 1
    }
    echo "Making $venv with $("$python" --version)"
    # From scratch, so that nothing of an older lock file stays behind.
    "$python" -m venv --clear "$venv"
    "$venv/bin/python" -m pip install --require-hashes -r requirements.lock
    cp requirements.lock "$made_from"
fi

"$venv/bin/python" -m pip install --quiet --no-deps --no-build-isolation --editable .
# Says where pyproject.toml asks for what the lock file does not have.
"$venv/bin/python" -m pip check || {
    echo "requirements.lock does not fit pyproject.toml: run make lock." >&2
    exit 1
}
