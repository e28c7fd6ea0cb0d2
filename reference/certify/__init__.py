"""First surface along each line: proven in floating point, computed in integers, or a tie.

* cone: edge functions and planes of triangles seen from a center, with rounding bounds
* boxes: broad phase, the bounding box on the film of every triangle that may be visible
* filter: narrow phase, nearest certain and nearest possible surface of each pixel
* certify: decision of each pixel: by rounding bounds, as a tie, or in integers
* exact: integer arithmetic: whether and where a line meets a triangle
* occlusion: points of an image that other surfaces hide on the points' own lines
"""
