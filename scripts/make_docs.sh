#!/usr/bin/env bash
# Builds the site in build/docs: runs the examples of the gallery, and treats every warning as an
# error. External links are not followed. Arguments go to sphinx-build.
set -euo pipefail
cd "$(dirname "$0")/.."

python=${PYTHON_OF_DOCS:-.venv/bin/python}
"$python" -c 'import sphinx' 2>/dev/null || {
    echo "The site needs Sphinx: $python -m pip install --editable '.[docs]'" >&2
    exit 1
}
"$python" -m sphinx --builder html --conf-dir docs --doctree-dir build/doctrees --fail-on-warning --keep-going --quiet \
    "$@" . build/docs
echo "build/docs/index.html"
