"""The planner: settings to draw with, the fewest slabs, then the largest margin.

cuts          Where to cut: each height as near to the plate as a separation allows
displacement  How far the drawn picture is displaced, from the truth: a bound in closed form, and the
              model traced
hogels        How well settings do at single hogels, measured, and what that says of the plate
measure       Is a requirement met? Measured, by drawing the scene, and sheets at its farthest visible
              surfaces
numbers       Lengths of three significant digits: what a plan is made of, so that it can be read and typed
plan          The planner: the fewest slabs, and then the largest margin, that keep what is required
plate         A plan that holds for the plate: made from its worst apertures, measured at these and at a
              random sample
reason        Reasons of a plan, or for having none, in words
robust        The most robust of some settings that all hold: with a margin for what was not looked at
search        The best plan with a given number of cuts: how large near may be, and whether all is kept
sheets        Two parallel sheets at the far end of a camera, drawn and counted: does a depth buffer tell
              them apart?
viewer        What a viewer requires of a plan: nothing that eyes can see, whatever hogels' pixels show
views         The requirement that a plan must keep, and what some apertures of a scene truly show
"""
