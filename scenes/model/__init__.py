"""The scene that is asked about, and the image that every renderer returns.

effects             What a scene calls for, and why: decided before anything runs, from the scene alone
hogel_image         The one kind of image that every renderer returns: what one aperture shows, pixel by
                    pixel
look                A hash of what a scene looks like, beside that of its geometry
plate_content       A plate as a stream of hogels: what of each is wanted, and what each brings
rendering           What made the color of an image: which effects, how many samples, which light transport
scene               A scene: what is asked of every renderer. Immutable, validated, in scene coordinates
slabs               Which slabs of both frusta the scene has something in: what is drawn, and what is
                    skipped
surface_attributes  What shading needs of the surfaces, of all objects together, numbered as the scene's
                    triangles are
"""
