"""The plate, its apertures, their crossed frustum, and the settings of the two cameras.

double_frustum  The settings of the paper's double frustum, with which a rasterizer draws (paper, section 4)
frustum         The crossed frustum's parameters: its film, its angles or its projection screen, its reach
plate           The plate and its apertures, also by blocks of columns and rows
"""
