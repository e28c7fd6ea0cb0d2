"""Conformance run of all wrong renderers: `python -m tests.conformance` prints their table."""

import argparse
import sys

from tests.conformance.table import HEADER, WRONG, failures, row, tried


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.conformance", description=__doc__)
    parser.add_argument("--renderer", choices=[r.name for r in WRONG], action="append")
    names = parser.parse_args().renderer
    sys.stdout.write(HEADER + "\n")
    results = []
    for renderer in WRONG:
        if not names or renderer.name in names:
            results.append(tried(renderer))
            sys.stdout.write(row(results[-1]) + "\n")
            sys.stdout.flush()
    sys.stdout.write(f"\nrenderers: {len(results)}\n")
    for problem, some in failures(results).items():
        sys.stdout.write(f"{problem}: {', '.join(some) or '-'}\n")


if __name__ == "__main__":
    main()
