#!/usr/bin/env bash
# Prints a Python that can make the virtual environment: $PYTHON if set, else the first suitable
# Python. Fails without output if there is none; callers print advice.
set -euo pipefail

fits='import sys, ensurepip, venv; print(sys.executable); sys.exit(sys.version_info < (3, 11))'

for candidate in ${PYTHON:-python3.11 python3.12 python3.13 python3.14 python3}; do
    if found=$("$candidate" -c "$fits" 2>/dev/null); then
        echo "$found"
        exit 0
    fi
done
exit 1
