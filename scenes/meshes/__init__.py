"""Mesh files as scene objects: each feature is read, listed as unread, or refused.

mesh_file       One mesh file as one object: reader by suffix, checks of all formats
content         Result of a reader: parts, unread features, textures; placing of normals
gltf            glTF: nodes, instances, morph targets and skins at rest, base colors
gltf_data       Document, buffers and accessors of a glTF file
obj             Wavefront OBJ and its material libraries
ply_off_stl     PLY, OFF and STL: lists of vertices and polygons
packages        3MF and 3DXML: zip packages of XML parts, and placing of their objects
tessellation    Polygons, and Bezier patches of `.bpt` files, cut into triangles without cracks
text_lines      Lines of a text as arrays of numbers; errors name the line
"""
