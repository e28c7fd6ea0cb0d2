"""A model of somebody else's renderer: conventions, geometry, what it draws.

conventions   The conventions that a renderer's author may declare: their names, which are checked
              without more
drawn_color   The color of what a guess about a renderer makes of a scene: the reference's own light on
              its surfaces
drawn_model   A model of how somebody drew a plate: conventions, geometry, and which camera wins where
drawn_trace   Images that a model of a renderer makes of a scene, traced and decided like the truth
orientations  The eight symmetries of the rectangle's grid: how a picture may be turned, or apertures be
              counted
parameters    Parameters of a guessed renderer in groups that tend to be wrong together: one table for
              all their uses
pictures      Pictures without numbers of triangles: the reference's own color, and how far another may
              be off
shown_points  The surface point that a pixel shows, when an image says only which triangle
"""
