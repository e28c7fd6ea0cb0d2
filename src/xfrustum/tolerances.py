"""Default limits of pictures: the one place for these numbers."""

#: Largest 99th percentile of displacement, in pixels: a point that moves by less than half a pixel
#: mostly stays within its pixel.
TOLERANCE_PX = 0.5

#: Largest share of pixels with a wrong surface. Displacement is judged by its 99th percentile,
#: which ignores one pixel in a hundred; the same share of pixels may show another surface.
MAX_WRONG = 1e-2

#: largest share of pixels whose wrong surface is charged to depth
MAX_DEPTH_WRONG = 1e-3

#: Default size of the random sample of hogels: if no sampled hogel is beyond the limits, at most
#: one hogel in twenty of the plate is, with a confidence of 95 % (0.95^59 < 0.05).
SAMPLED_HOGELS = 59
