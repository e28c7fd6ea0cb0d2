"""Which apertures of a plate decide the error: a look through many, before any is measured.

scout  A coarse film of certified lines through apertures all over the plate, denser where the error is largest
"""
