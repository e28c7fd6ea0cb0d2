"""`xfrustum check` and `xfrustum new`: where a scene lies, before it is drawn, and a scene that fits a mesh.

checking   What lies where in a scene, which apertures see it, and what looks like a mistake
drawing    The side view and the top view of a scene, as one small SVG each
new_scene  A scene file whose plate, reach and field of view fit a mesh
"""
