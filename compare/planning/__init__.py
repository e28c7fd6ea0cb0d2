"""The planner: the fewest slabs, then the largest margin, that meet a requirement.

requirement  Limits that a picture must keep, and errors that are held against them
viewer       Limits of a viewer's eyes, and the view zone of a plate
views        True images of some apertures, and errors that closed forms predict of settings
search       Scan over numbers of cuts, with monotone searches for cuts and for near
limits       Range of near that depth buffers, pixels and eyes each allow
measure      Errors of drawn hogels, and of sheets at the farthest visible surfaces
plan         Plans for some apertures, and for a plate from its worst apertures and random samples
"""
