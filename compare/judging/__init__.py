"""One hogel of a foreign renderer judged; `xfrustum.compare.run` judges those of our own rasterizer.

foreign_cameras  The cameras of a foreign renderer, with bounds of rounding for a precision that nobody
                 has stated
image_displacement  How far what an image shows has moved: by its surface points, or by its outlines
judged           One hogel of a foreign renderer, judged by a question: the truth, or what its author
                 declares
outline_shift    Displacement of a picture's outlines by registration, where no pixel names a triangle
"""
