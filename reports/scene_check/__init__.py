"""Scenes before anything is drawn: how they fit the plate, in words and in pictures, and new ones that do.

checking       `xfrustum check`: what lies where, who sees it, and what looks like a mistake
drawing        the side view and the top view, as SVG
picture_frame  what a view shows of space, and where that lies on the picture
silhouettes    outlines of meshes as they are seen from the side or from above
page_section   the same pictures as a section of a report's page
new_scene      `xfrustum new`: a scene file whose plate and reach fit a mesh
"""
