"""Plates in Zarr groups, drawn by any number of processes.

plate   Renderers of hogels, and plates drawn block by block
arrays  Arrays of a plate: labels, blocks of hogels, checks of stored arrays
store   Writing of blocks and measures; size of a plate on the disk
reader  Reading of stored plates: hogels and cameras
"""
