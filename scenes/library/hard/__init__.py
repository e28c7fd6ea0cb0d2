"""Hard cases: scenes at which renderers of crossed frusta fail.

aimed    Hard cases in which lines meet vertices and edges exactly, or surfaces the aperture itself
case     The class of hard cases, and the frustum that most of them share, whose lines doubles hold
         exactly
cases    The suite of hard cases: scenes at which renderers of crossed frusta fail (docs/hard-cases.md)
frusta   Hard cases of size, place and view: far, tiny, huge, steep, sheared, one pixel, giants
sheets   Hard cases of depth order: coincident and nearly coincident sheets, and the ends of the reach
slivers  Hard cases of triangles that are hardly there: edge-on, needles, without area, twice, tiny
"""
