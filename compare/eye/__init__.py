"""What a viewer sees: the display's loss, the renderer's, and the scene that a near offset replays.

loss        The display's loss (A against B), the renderer's (B against C), and the disparity of two eyes
noticeable  Where points are replayed, and what an eye notices of a near offset and of a depth buffer
shown       The replayed image: pixels of hogels that an eye is shown, and the surface points these show
"""
