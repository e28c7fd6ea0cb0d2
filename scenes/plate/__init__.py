"""The plate, its apertures, their crossed frustum, and the settings of the two cameras.

aperture_blocks  Apertures by blocks of columns and rows: counted and gone through without ever being listed
double_frustum   The settings of the paper's double frustum, with which a rasterizer draws (paper, section 4)
frustum          The crossed frustum's parameters: its film, its angles or its projection screen, its reach
plate            The plate and its apertures (paper, section 3; frames in CONVENTIONS.md)
"""
