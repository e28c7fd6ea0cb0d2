"""Limits that pictures are held to where nobody states others: the one place for these numbers."""

TOLERANCE_PX = 0.5
"""Largest 99th percentile of displacement, in pixels: a point that moves by less than half a pixel mostly
stays within its pixel."""

MAX_WRONG = 1e-2
"""Largest share of pixels with a wrong surface. Displacement is judged by its 99th percentile, which leaves
one pixel in a hundred out; as many may show another surface."""

MAX_DEPTH_WRONG = 1e-3  #: largest share of pixels whose wrong surface is charged to depth

SAMPLED_HOGELS = 59
"""Hogels of the random sample unless another number is asked for: if none of them is beyond what is required,
no more than one hogel in twenty is, with a confidence of 95 % (0.95^59 < 0.05)."""
