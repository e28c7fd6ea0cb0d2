"""Scenes by what people type.

catalogue  Scenes by what people type: the path of a scene file, or the name of a built-in scene
"""
