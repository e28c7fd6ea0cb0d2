"""A renderer of ten lines, for `verify --command`: the column and the row as a color."""

import sys
import time

from PIL import Image

PRETENDED_WORK_S = (
    0.2  # time that it seems to draw for, so that a signal to `verify` finds it at work
)

if __name__ == "__main__":
    column, row, out = sys.argv[1:]
    time.sleep(PRETENDED_WORK_S)
    Image.new("RGB", (16, 12), (0, 0, 20 + int(column) + int(row))).save(out)
