"""What a viewer sees: the display's loss, the renderer's, and the scene that a near offset replays.

collected     Drawn hogels as an eye is shown them: pixels picked from hogels that are drawn, stored or
              foreign
drawn_points  The surface point that each pixel of a drawn view shows, from its triangle and its camera's
              line
limits        The limits of a display and of an eye at a distance, and the near offset that stays below
              them
loss          The loss on the way to an eye: the display's (A against B) and the renderer's (B against C)
moved         The scene that a viewer sees where cameras step back by a near offset: a theorem and its
              closed form
noticeable    What an eye notices of a near offset and of a depth buffer: closed forms, for the depths a
              plate shows
stereo        Two eyes: how far the disparity of surface points is off, and at which depth they are
              therefore seen
"""
