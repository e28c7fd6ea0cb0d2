"""Many hogels per submission, with the same pictures as `Rasterizer`.

* renderer: a plate as a stream of hogels
* picture: programs, draws, submissions and rounds of several hogels
* targets: framebuffers with a layer for each hogel
* clusters: culling of clusters of triangles outside the frusta of a hogel
* one_by_one: hogels drawn one by one, means over sub-apertures, and the plain loop of benchmarks
"""
