"""Scenes from files: tables, maps and images.

layouts           Layouts: the ways in which people store the pictures of a plate, as a table
channels          Channel names of OpenEXR files as other programs write them exr
Hogel images and other pictures as OpenEXR files exr_storage       Error bounds of OpenEXR's types
and compressions foreign_images    Hogel images as other renderers write them: numbers packed in
RGB, plain pictures, OpenEXR pictures          Pictures, videos and environment maps as arrays
plate_files       The pixels of a plate in files of any layout: found, read row by row, and written
scene_file        The scene file (TOML; CONVENTIONS.md, "The scene file"): its tables, checked key
by key
"""
