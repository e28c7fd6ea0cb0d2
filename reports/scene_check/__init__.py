"""`xfrustum check` and `xfrustum new`: facts of a scene, and a scene file that fits a mesh.

checking   Position and visibility of objects, likely mistakes, and two views
effects    Effects that a scene needs, and closed-form errors by depth
new_scene  A scene file whose plate, reach and field of view fit a mesh
"""
