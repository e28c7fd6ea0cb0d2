"""One hogel of a foreign renderer judged (`judged`); `xfrustum.compare.run` judges our own rasterizer's."""
