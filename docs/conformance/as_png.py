"""Run a renderer on a case and convert its PPM images to PNG: as_png.py RENDERER CASE OUT."""

import subprocess
import sys
from pathlib import Path

from PIL import Image

renderer, case, out = sys.argv[1:]
done = subprocess.run([renderer, case, out], check=False)
for file in Path(out).glob("*.ppm"):
    with Image.open(file) as picture:
        picture.save(file.with_suffix(".png"))
sys.exit(done.returncode)
