"""The plate, its apertures, their crossed frustum, and the settings of the two cameras.

double_frustum  The settings of the paper's double frustum, with which a rasterizer draws (paper,
section 4) plate           The plate and its apertures, and the film, angles or screen, and reach of
their frustum
"""
