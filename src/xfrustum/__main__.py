"""`python -m xfrustum`."""

from __future__ import annotations

import sys

from xfrustum.cli import main

if __name__ == "__main__":
    sys.exit(main())
