#!/usr/bin/env bash
# Prints a Python that can make the virtual environment: $PYTHON if set, else the first one that fits.
# Prints nothing and fails where there is none; the callers say what to do about it.
set -euo pipefail

fits='import sys, ensurepip, venv; print(sys.executable); sys.exit(sys.version_info < (3, 11))'

for candidate in ${PYTHON:-python3.11 python3.12 python3.13 python3.14 python3}; do
    if found=$("$candidate" -c "$fits" 2>/dev/null); then
        echo "$found"
        exit 0
    fi
done
exit 1
