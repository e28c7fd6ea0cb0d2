"""`xfrustum check` and `xfrustum new`: the place of a scene, and a scene that fits a mesh.

checking   Place and visibility of objects, likely mistakes, and two views
effects    Effects that a scene calls for, and closed-form errors by depth
new_scene  A scene file whose plate, reach and field of view fit a mesh
sight      Sentences about objects unseen, cut by the reach, tiny, or in the plate
"""
