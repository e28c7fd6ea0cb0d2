"""The exchange with other programs: plates in layouts of files, and cameras for other renderers.

blender/        Blender: the crossed frustum as a camera shader of Cycles, and the script that renders it
camera_files    Files of cameras for other renderers: JSON, glTF, Mitsuba and Blender
camera_formats  The cameras C and C* as nodes of a glTF file, and as sensors of Mitsuba 3
cameras         The cameras C and C* of any settings and aperture, for renderers that somebody else writes
convert         Plates from one layout into another, and from and into Zarr
drawn           Plates that are drawn, in layouts of files: beside their Zarr groups, or instead of them
"""
