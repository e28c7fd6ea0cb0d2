"""Hogel images as OpenEXR files.

channels    Names, types and pixels of an image's OpenEXR channels; its camera and rendering as text
eye_writer  Writing what an eye sees as OpenEXR: the channels of hogel images, and the eye in the header
header      The header of an OpenEXR file, checked before the library sees it
images      Hogel images as OpenEXR files (CONVENTIONS.md, "Image files"): one door for reading and writing
reader      Reading hogel images from OpenEXR files, by this or any other renderer
whole       Whether an OpenEXR file is complete, seen from its layout alone, without its pixels
writer      Writing hogel images as OpenEXR files, band by band, aside and then renamed
"""
