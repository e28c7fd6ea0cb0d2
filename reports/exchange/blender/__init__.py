"""Blender: the script that renders the crossed frustum as a camera shader of Cycles.

pixel_files  Files of hogels in plain Python, from what Cycles renders: PNG, and OpenEXR without
             compression
render       A program of its own, run by Blender: renders hogels of a plate with Cycles
"""
