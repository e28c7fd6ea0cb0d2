"""Many hogels per submission, with the same pictures as `Rasterizer`.

* renderer: a plate as a stream of hogels, several per submission or one by one
* picture: programs, draws, submissions and rounds of several hogels
* directions: a plate drawn by directions, one picture for each pixel of its hogels
* clusters: culling of clusters of triangles outside the frusta of a hogel
"""
