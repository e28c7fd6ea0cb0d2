#!/usr/bin/env bash
# Makes .venv with exactly the packages of requirements.lock and the project itself, editable: by uv
# if it is installed or can be fetched (a tenth of the time), else by pip. An environment made from
# the same lock file is kept. NO_UV=1 selects pip.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/steps.sh

venv=.venv
made_from=$venv/requirements.lock
uv=

# Passes pip's configuration to uv, which does not read pip's files and variables.
configure_uv() {
    local configured
    configured=$("$venv/bin/python" -m pip config list 2>/dev/null)
    told() { sed -n "s/^[^=]*\.$1='\(.*\)'\$/\1/p" <<<"$configured" | tail -n 1; }
    local index extra links certificates
    index=$(told index-url) extra=$(told extra-index-url) links=$(told find-links) certificates=$(told cert)
    [ -z "$index" ] || export UV_DEFAULT_INDEX=$index
    [ -z "$extra" ] || export UV_INDEX=$extra
    [ -z "$links" ] || export UV_FIND_LINKS=$links
    [ -z "$certificates" ] || export SSL_CERT_FILE=$certificates
    [ -z "$(told no-index)" ] || export UV_NO_INDEX=1
}

# Sets uv to a working program: on the path, fetched by an earlier run, or fetched by pip now.
find_uv() {
    [ -z "${NO_UV:-}" ] || return 0
    for candidate in uv build/uv/bin/uv build/lock/bin/uv; do
        if "$candidate" --version >/dev/null 2>&1; then
            uv=$candidate
            return
        fi
    done
    if step "fetch uv" "$venv/bin/python" -m pip install --quiet --target build/uv 'uv>=0.9,<1' 2>/dev/null; then
        uv=build/uv/bin/uv
    fi
}

install() {
    local with_uv=(--quiet --python "$venv/bin/python" --require-hashes --requirement requirements.lock)
    if [ -n "$uv" ] && step "$count packages of requirements.lock (uv)" "$uv" pip install "${with_uv[@]}"; then
        return
    fi
    step "$count packages of requirements.lock (pip)" "$venv/bin/python" -m pip install --quiet \
        --disable-pip-version-check --no-compile --require-hashes --requirement requirements.lock
}

if ! { cmp -s requirements.lock "$made_from" && "$venv/bin/python" -m pip --version; } >/dev/null 2>&1; then
    python=$(scripts/find_python.sh) || {
        echo "Python 3.11 or newer with venv is needed; install one, or set PYTHON to its path." >&2
        exit 1
    }
    # --clear removes the packages of an older lock file.
    step "$venv with $("$python" --version)" "$python" -m venv --clear "$venv"
    count=$(grep -c '^[A-Za-z0-9]' requirements.lock)
    configure_uv
    find_uv
    install
    cp requirements.lock "$made_from"
fi

# Uses uv if this run has found it; pip takes seconds to start.
pip() {
    { [ -n "$uv" ] && "$uv" pip "$@" --python "$venv/bin/python"; } ||
        "$venv/bin/python" -m pip --disable-pip-version-check "$@"
}

step "xfrustum itself, editable" pip install --quiet --no-deps --no-build-isolation --editable .
# Fails if pyproject.toml requires packages that the lock file does not have.
step "check that all packages fit" pip check || {
    echo "requirements.lock does not fit pyproject.toml: run make lock." >&2
    exit 1
}
