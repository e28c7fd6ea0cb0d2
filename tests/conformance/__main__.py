"""Conformance run of all wrong renderers: `python -m tests.conformance` prints their table."""

from tests.conformance.table import WRONG, failures, row, tried

if __name__ == "__main__":
    results = []
    for renderer in WRONG:
        results.append(tried(renderer))
        print(row(results[-1]), flush=True)  # noqa: T201
    print(f"renderers: {len(results)}", failures(results), sep="\n")  # noqa: T201
