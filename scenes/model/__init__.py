"""The scene that is asked about, and the image that every renderer returns.

device_model   How a device draws: its roundings, known by measurement and not from its maker
effects        The effects that a scene calls for, and why; a bound of the space that images can
show eye            An eye before the plate, the pixels of hogels that it is shown, and what it sees
hogel_image    The one kind of image that every renderer returns: what one aperture shows, pixel by
pixel plate_content  A plate as a stream of hogels: the arrays that are wanted, and those of each
hogel scene          A scene, the question to every renderer: immutable, validated, in scene
coordinates
"""
