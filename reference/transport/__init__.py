"""Light transport: shadows and interreflection, by light paths.

device_surfaces  Points of surfaces where light paths are computed, in double precision: only rays are in
                 single
device_tables    Tables and pictures where light paths are computed: Dr.Jit's arrays, or an entry at a
                 time without
light_paths      Light that comes from a surface point: directly, or by way of others, with shadows where
                 asked for
path_starts      Where light paths begin: on the film, where the reference's samples are, and as lines of
                 doubles
transport        Light transport that a rasterizer leaves out, by Mitsuba and the crossed frustum's sensor
"""
