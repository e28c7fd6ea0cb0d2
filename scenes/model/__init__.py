"""The scene that is asked about, and the image that every renderer returns.

effects             The effects that a scene calls for, and why: decided from the scene alone
eye                 An eye before the plate, and the pixels of hogels that it is shown
eye_image           What an eye sees, pixel by pixel: truly, or replayed by a plate of hogels
hogel_image         The one kind of image that every renderer returns: what one aperture shows, pixel by
                    pixel
image_facts         What images say of themselves: in words, in tables and pictures, and as labelled arrays
look                The look of a scene: whether it says anything of it, and a hash beside that of its
                    geometry
plate_content       A plate as a stream of hogels: the arrays that are wanted, and those of each hogel
region              A bound of the space that images can show, with the largest near offset and all rounding
rendering           The effects, samples and light transport that made the color of an image
scene               A scene, the question to every renderer: immutable, validated, in scene coordinates
scene_facts         What a scene says of itself: in words, in tables, and as silhouettes
slabs               The slabs of both frusta, and the number of the scene's triangles in each
surface_attributes  Normals, colors and textures of all objects together, numbered as the scene's triangles
"""
