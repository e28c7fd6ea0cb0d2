"""Plates in Zarr groups, drawn by any number of processes.

plate       Renderers of hogels, and plates drawn block by block
arrays      Arrays of a plate: labels, blocks of hogels, checks of stored arrays
store       Stored plates: writing of blocks and measures, reading of hogels and cameras
directions  Plates by directions, and the choice between directions and hogels
"""
