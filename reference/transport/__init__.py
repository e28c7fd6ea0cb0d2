"""Light transport: shadows and interreflection, by light paths.

transport    Light transport that a rasterizer leaves out, by Mitsuba and the crossed frustum's sensor
light_paths  Light that comes from a surface point, directly or by way of others, with shadows or without
surfaces     Points of surfaces where Mitsuba computes light paths, in double precision
"""
