"""Blender: the crossed frustum as a camera shader of Cycles, and the script that renders it.

export       What the script needs: the plate, and the scene's triangles with their numbers
pixel_files  Files of hogels in plain Python, from what Cycles renders: PNG, and OpenEXR without
             compression
render       A program of its own, run by Blender: renders hogels of a plate with Cycles
"""
