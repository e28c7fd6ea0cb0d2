"""The exchange with other programs: plates in layouts of files, and cameras for other renderers.

convert      Plates from one layout into another, and from and into Zarr
plate_group  Plates in Zarr groups, as arrays of pixels
"""
