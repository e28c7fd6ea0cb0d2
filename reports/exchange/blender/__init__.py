"""Blender: the script that renders the crossed frustum as a camera shader of Cycles.

render  Program of its own, run by Blender: renders hogels with Cycles and writes their files
"""
