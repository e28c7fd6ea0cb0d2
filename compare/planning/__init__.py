"""The planner: settings to draw with, the fewest slabs, then the largest margin.

views     What a plan must keep, what some apertures truly show, and what settings are predicted to
make of it limits    The near that each judge allows by itself: depth buffers from below, pixels of
hogels from above search    The best plan with a given number of cuts: where to cut, how large near
may be, what is most robust measure   Is a requirement met? Measured, by drawing the scene, and
sheets at its farthest visible surfaces viewer    What a viewer requires of a plan: nothing that
eyes can see, whatever hogels' pixels show plan      The plan for some apertures, and for the plate:
from its worst apertures, measured at a random
          sample
reasons   The reasons of a plan in words
"""
