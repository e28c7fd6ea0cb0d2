"""The planner: settings to draw with, the fewest slabs, then the largest near.

cuts          Where to cut: each height as near to the plate as a separation allows
displacement  How far the drawn picture is displaced, from the truth: a bound in closed form, and the
              model traced
measure       Is a requirement met? Measured, by drawing the scene, and sheets at its farthest visible
              surfaces
numbers       Lengths of three significant digits: what a plan is made of, so that it can be read and typed
plan          The planner: the fewest slabs, and then the largest near, that keep what is required
reason        Reasons of a plan, or for having none, in words
search        The best plan with a given number of cuts: how large near may be, and whether all is kept
sheets        Two parallel sheets at the far end of a camera, drawn and counted: does a depth buffer tell
              them apart?
views         The requirement that a plan must keep, and what some apertures of a scene truly show
"""
