"""Blender: the crossed frustum as a camera shader of Cycles, and the script that renders it.

export       What the script needs: the plate, and the scene's triangles with their numbers
long_run     What a run of hours needs: an end by Ctrl-C that loses nothing, the time left, and quiet
pixel_files  Files of hogels in plain Python, from what Cycles renders: PNG, and OpenEXR without
             compression
render       A program of its own, run by Blender: renders hogels of a plate with Cycles
"""
