"""`xfrustum check` and `xfrustum new`: the place of a scene, and a scene that fits a mesh.

checking   What lies where in a scene, which apertures see it, what looks like a mistake, and two
views new_scene  A scene file whose plate, reach and field of view fit a mesh
"""
