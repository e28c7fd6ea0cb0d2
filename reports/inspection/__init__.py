"""Inspection pages: every channel of truth and image at every pixel, and where they differ.

channels  Channels of a hogel, packed for a page: those of an image file, and what judging has found out
page      The inspection page: one file of bounded size, files beside it for what is larger
"""
