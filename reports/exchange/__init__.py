"""The exchange with other programs: plates in layouts of files, and cameras for other renderers.

blender/  Blender: the crossed frustum as a camera shader of Cycles, and the script that renders it
cameras   The cameras C and C* of any settings and aperture, in files for other renderers
convert   Plates from one layout into another, from and into Zarr groups, and as they are drawn
"""
