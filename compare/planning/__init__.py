"""The planner: the fewest slabs, then the largest margin, that meet a requirement.

requirement  Limits of pixels, depth buffers and a viewer's eyes, and the lengths of a plan
views        Errors of settings at some apertures: predicted by closed forms, and measured
search       Searches for cuts, near and depth buffer; range of near that each limit allows
plan         Plans for some apertures, and for a plate from its worst apertures and random samples
"""
