"""Pictures of a report: what encoding the first one must not take time for."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

PROGRAM = """
import sys
import numpy as np
from xfrustum.reports.error_report import images
from PIL import Image

loaded = set(sys.modules)
Image.fromarray(np.zeros((2, 2, 4), np.uint8)).save(open(sys.argv[1], "wb"), "WEBP")
print(*sorted(set(sys.modules) - loaded))
"""


def test_the_first_picture_does_not_import_the_plugins_of_all_formats(tmp_path: Path) -> None:
    told = subprocess.run(
        [sys.executable, "-c", PROGRAM, f"{tmp_path}/picture"], capture_output=True, text=True, check=True
    )
    assert not [name for name in told.stdout.split() if name.endswith("ImagePlugin")]
