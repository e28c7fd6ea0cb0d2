"""Mesh files as scene objects: each feature is read right, listed as unread, or refused.

mesh_file    One mesh file as one object: the reader of its format, the checks that all formats
share content      Result of a reader: parts with their attributes, and features that are not
honoured textures     Pictures of base colors, decoded once each gltf         glTF files: nodes,
instances, morph targets and skins at rest gltf_data    Document, buffers and accessors of a glTF
file gltf_materials  Base colors and textures of glTF materials obj, obj_materials  Wavefront OBJ
and its material libraries off, ply, stl  OFF, PLY and STL threemf, threedxml  3MF and 3DXML,
packages of XML package      Zip packages of XML parts, and placing of their objects polygons
Polygons cut into triangles text_lines   Lines of a text as arrays of numbers, and errors that name
the line
"""
