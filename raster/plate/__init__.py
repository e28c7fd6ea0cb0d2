"""Many hogels at once: the pictures of `Rasterizer` in fewer submissions.

* renderer: a plate as a stream of hogels
* picture: programs, draws, submissions and rounds of several hogels
* targets: framebuffers with a layer for each hogel
* clusters: clusters of triangles outside the frusta of a hogel
* one_by_one: hogels one by one, averaged over sub-apertures, and the plain loop of benchmarks
"""
