"""Freeze a conformance suite: write the digests of its truths into the list of its cases.

`python scripts/freeze_conformance_suite.py FOLDER` replaces FOLDER/cases.toml. FOLDER holds
cases.toml, scenes and meshes, as `scenes/conformance/1.0` does. A released suite never changes: a
new version begins with a copy of its folder.
"""

import json
import sys
import tomllib
from pathlib import Path
from typing import Any

from xfrustum.compare.judging.conformance import digest, mean_radiance, trace
from xfrustum.reference import Reference
from xfrustum.scenes import conformance_suite


def frozen(table: dict[str, Any]) -> dict[str, Any]:
    """Return the table of a case with the digest and the mean radiance of its truths."""
    case = conformance_suite.Case.from_table(table)
    scene = case.open()
    reference = Reference(scene)
    truths = [trace(case, reference, aperture) for aperture in case.apertures(scene)]
    shown = sum(int(truth.covered.sum()) for truth in truths)
    share = shown / sum(truth.triangle.size for truth in truths)
    sys.stdout.write(f"{case.name}: {share:.0%} of the pixels show a surface\n")
    radiance = mean_radiance(truths)
    table = table | {"digest": digest(truths)}
    return table if radiance is None else table | {"radiance": round(radiance, 6)}


def main() -> None:
    """Freeze the suite in the folder of the command line."""
    conformance_suite.FOLDER = Path(sys.argv[1])
    path = conformance_suite.FOLDER / "cases.toml"
    lines = []
    for table in tomllib.loads(path.read_text(encoding="utf-8"))["case"]:
        lines.append("[[case]]")
        # Every value is a string, a number or a list of these, which JSON and TOML write alike.
        lines += [f"{key} = {json.dumps(value)}" for key, value in frozen(table).items()]
        lines.append("")
    path.write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
