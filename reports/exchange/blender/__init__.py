"""Blender: the script that renders the crossed frustum as a camera shader of Cycles.

render  A program of its own, run by Blender: renders hogels of a plate with Cycles, and writes
their files
"""
