"""Light transport: shadows and interreflection, by light paths.

device_surfaces  Points of surfaces on the device that computes light paths, in double precision
device_tables    Tables and pictures on the device that computes light paths
light_paths      Light that comes from a surface point, directly or by way of others, with shadows or
                 without
path_starts      The lines on which light paths begin: those of the reference's samples on the film, as
                 doubles
transport        Light transport that a rasterizer leaves out, by Mitsuba and the crossed frustum's sensor
"""
