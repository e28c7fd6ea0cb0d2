"""Mesh files: what is checked, what is read, and nothing that is made up.

attributes   Normals and colors at the vertices of mesh files: what the file has, and nothing that is
             made up
gltf_header  The JSON header of glTF files, read without trimesh: base colors and names of textures
meshes       Mesh files through trimesh, numbered as the contract says (CONVENTIONS.md, "Triangles and
             objects")
parts        The parts of a mesh file as trimesh reads them, without what trimesh makes up (docs/adr/0007)
patches      Bezier patch files (`.bpt`): read, checked, and tessellated to a chord tolerance
source       Checks of a mesh file before trimesh reads it: of its declared size and of files it refers to
textures     Textures of mesh files: those that the file has, and a warning for each that it names in vain
"""
