"""What a viewer sees: the display's loss, the renderer's, and the scene that a near offset replays.

loss        Pixels of hogels that an eye is shown; the display's loss, the renderer's, and that of
two eyes noticeable  Where points are replayed, and what an eye notices of a near offset and of a
depth buffer
"""
