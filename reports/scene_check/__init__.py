"""Scenes before anything is drawn: how they fit the plate, in words and in pictures, and new ones that do.

checking       `xfrustum check`: what lies where in a scene, which apertures see it, and what looks like
               a mistake
drawing        The side view and the top view of a scene: plate, reach, frusta and objects, as one small
               SVG each
new_scene      `xfrustum new`: a scene file whose plate, reach and field of view fit a mesh
page_section   The section of a page that shows where a scene lies, for `_scene.html.j2`
picture_frame  What a view shows of space, and where that lies on the picture
silhouettes    Outlines of meshes as they are seen from the side or from above
"""
