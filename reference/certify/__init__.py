"""Where a pixel is proven: the first surface along each line, proven, decided exactly, or named a tie.

cone             Triangles as seen from a pencil's center: edge functions and planes, roundings
bounded boxes            The broad phase: the bounding box, on the film, of every triangle that may
show there filter           The narrow phase: nearest sure and nearest possible surface of each
pixel certify          The decision: what bounds settle is proven, what coincides a tie; integers
decide the rest exact            Decisions in integers: whether and where a line meets a triangle
occlusion        The occlusion query: which drawn points another surface hides on their own lines
arbitrary_lines  First surfaces along any lines through one point; all decided in integers
"""
