"""Print the table of all renderers, or of some: `python -m tests.wrong_renderers --scene attic`."""

import argparse
import sys
import tempfile
from pathlib import Path

from tests.wrong_renderers.new_toys import TOYS
from tests.wrong_renderers.outcomes import HEADER, SCENES, Studio, cases, row, tally
from tests.wrong_renderers.toys import ENCODINGS, GROUPS, SRGB


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.wrong_renderers", description=__doc__)
    parser.add_argument("--scene", choices=tuple(SCENES), action="append")
    parser.add_argument("--renderer", choices=tuple(TOYS), action="append")
    parser.add_argument("--encoding", choices=(*ENCODINGS, SRGB), action="append")
    parser.add_argument("--group", choices=GROUPS, action="append")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        studio = Studio(folder=Path(folder))
        sys.stdout.write(HEADER + "\n")
        for case in cases():
            filters = (options.scene, options.renderer, options.encoding, options.group)
            has = (case.scene, case.toy, case.encoding, TOYS[case.toy].group)
            if all(not of or value in of for of, value in zip(filters, has, strict=True)):
                sys.stdout.write(row(studio.outcome(case)) + "\n")
                sys.stdout.flush()
        sys.stdout.write("\n" + tally(tuple(studio.done.values())) + "\n")


if __name__ == "__main__":
    main()
