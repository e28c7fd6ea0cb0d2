"""Wrong renderers through the suite: `python -m tests.conformance` prints the table of them all."""

import argparse
import sys

from tests.conformance.table import HEADER, WRONG, row, tally, tried


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.conformance", description=__doc__)
    parser.add_argument("--renderer", choices=tuple(one.name for one in WRONG), action="append")
    asked = parser.parse_args().renderer
    sys.stdout.write(HEADER + "\n")
    done = []
    for one in WRONG:
        if not asked or one.name in asked:
            done.append(tried(one))
            sys.stdout.write(row(done[-1]) + "\n")
            sys.stdout.flush()
    sys.stdout.write("\n" + tally(done) + "\n")


if __name__ == "__main__":
    main()
