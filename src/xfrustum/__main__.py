"""The program `xfrustum`, also as `python -m xfrustum`."""

from __future__ import annotations

import sys

from xfrustum.cli.main import run

if __name__ == "__main__":
    sys.exit(run())
