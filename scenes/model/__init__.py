"""Scenes, images, and the devices and eyes for which they are drawn.

device_model  Measured rounding of drawing devices
effects       Effects of light and geometry that a scene needs, with reasons
eye           Eye in front of the plate, and the pixels of hogels in its view
images        Images of a hogel, by direction, and of a plate as a stream of hogels
scene         A scene in scene coordinates: immutable and validated
visibility    Surfaces that may be visible from apertures, ignoring occlusion
"""
