"""First surface along each line: proven in floating point, decided in integers, or a tie.

* cone: triangles seen from a center: edge functions and planes, with bounds of rounding
* boxes: broad phase, the bounding box on the film of every triangle that may show there
* filter: narrow phase, nearest sure and nearest possible surface of each pixel
* certify: the decision: proven by bounds, a tie of coincident triangles, or decided in integers
* exact: decisions in integers: whether and where a line meets a triangle
* occlusion: points of an image hidden by other surfaces on their own lines
"""
