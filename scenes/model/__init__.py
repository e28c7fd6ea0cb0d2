"""Scenes, hogel images, and the devices and eyes that they are drawn for.

device_model   Roundings of a device that draws, by measurement
effects        Effects of light and geometry that a scene needs, with reasons
eye            An eye before the plate, and the pixels of hogels that reach it
hogel_image    The image of one aperture, the result of every renderer
plate_content  A plate as a stream of hogels: requested images, and the arrays of each hogel
scene          A scene in scene coordinates: immutable and validated
visibility     Surfaces that images of some apertures can show, occlusion ignored
"""
