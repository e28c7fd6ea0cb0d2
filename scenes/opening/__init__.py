"""Scenes by name or path.

catalogue  Scenes by name or path: the path of a scene file, or the name of a built-in scene
"""
