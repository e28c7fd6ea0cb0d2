"""A model of somebody else's renderer: conventions, geometry, what it draws.

conventions   The conventions that a renderer's author may declare: their names, which are checked
              without more
drawn_model   A model of how somebody drew a plate: conventions, geometry, and which camera wins where
orientations  The eight symmetries of the rectangle's grid: how a picture may be turned, or apertures be
              counted
parameters    The numbers of a guessed renderer, in groups that tend to be wrong together: one table for all
              their uses
pictures      Images that a guess about a renderer makes of a scene: traced and decided like the truth, and
              colored
shown_points  The surface point that a pixel shows, when an image says only which triangle
"""
