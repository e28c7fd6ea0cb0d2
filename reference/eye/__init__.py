"""What an eye before the plate sees, truly and replayed, certified.

first  The first surface along lines that have no common point: proven, or decided in integers
rays   The rays of an eye, and the pixel of a hogel that each of them takes
view   True views and replayed views, with points and color
"""
