"""Scenes from files: tables, maps and images.

layouts         Layouts of the pictures of a plate, one table row each
channels        Channel names of OpenEXR files of other programs, and error bounds of stored values
exr             Hogel images and other pictures as OpenEXR files
pictures        Pictures, environment maps, and hogel images of other renderers as arrays
plate_files     Pixels of a plate in files of any layout: recognized, read by rows, and written
scene_file      Scene file (TOML; CONVENTIONS.md, "The scene file"): tables checked key by key
"""
