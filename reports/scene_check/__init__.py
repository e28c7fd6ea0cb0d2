"""`xfrustum check` and `xfrustum new`: where a scene lies, before it is drawn, and a scene that fits a mesh.

checking   What lies where in a scene, which apertures see it, what looks like a mistake, and two
views new_scene  A scene file whose plate, reach and field of view fit a mesh
"""
