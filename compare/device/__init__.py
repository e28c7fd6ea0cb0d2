"""Measurement of an OpenGL device: its rounding from a fingerprint, and recorded frames.

fingerprints  Rounding of a device from its fingerprint, compared with a model recorded Frames
recorded on any machine, explained by the model of their device
"""
