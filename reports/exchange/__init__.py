"""Exchange with other programs: plates in layouts of files, and cameras for other renderers.

blender   Crossed frustum as a camera shader of Cycles, and the script that renders it
cameras   Cameras C and C* of any settings and aperture, in files for other renderers
convert   Plates converted between layouts and Zarr groups, and laid out after drawing
"""
