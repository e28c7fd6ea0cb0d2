"""Plates in Zarr groups, drawn by any number of processes.

plate   Renderers of hogels, and plates drawn block by block, never twice
arrays  Arrays of a plate, their labels, their blocks of hogels, and checks of stored ones
store   Writing of blocks and of the table of measures; size of a plate on the disk
reader  Reading of stored plates: hogels and cameras
"""
