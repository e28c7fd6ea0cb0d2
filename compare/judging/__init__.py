"""One hogel of a foreign renderer judged; `xfrustum.compare.run` judges those of our own rasterizer.

image_displacement  How far what an image shows has moved: by its surface points, or by registration of
                    its outlines
judged              One hogel of a foreign renderer, judged by a question: the truth, or what its author
                    declares
"""
