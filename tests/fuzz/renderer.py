"""A renderer of ten lines, for `verify --command`: column and row of the hogel as a color."""

import sys
import time

from PIL import Image

PRETENDED_WORK_S = 0.2  # simulated drawing time, so that signals to `verify` arrive while it runs

if __name__ == "__main__":
    column, row, out = sys.argv[1:]
    time.sleep(PRETENDED_WORK_S)
    Image.new("RGB", (16, 12), (0, 0, 20 + int(column) + int(row))).save(out)
