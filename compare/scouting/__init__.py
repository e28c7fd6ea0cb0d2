"""Which apertures of a plate decide the error: a look through many, before any is measured.

sample  Random samples of hogels, and what they bound: the share of a plate's hogels with a property
scout   Coarse films of certified lines through apertures all over a plate, more where the error is largest
"""
