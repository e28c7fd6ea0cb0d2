"""The program `xfrustum`, also as `python -m xfrustum`."""

import sys

from xfrustum.cli.main import run

if __name__ == "__main__":
    sys.exit(run())
