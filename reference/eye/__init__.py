"""What an eye before the plate sees, truly and replayed, certified.

crossing  Lines without a common point: which triangles they may cross, found from where the eye sees these
first     The first surface along each line of a grid: proven, or decided in integers
rays      The rays of an eye, and the pixel of a hogel that each of them takes
view      True views and replayed views, with points and color
"""
