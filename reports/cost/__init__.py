"""What accuracy costs in time.

cost  `xfrustum cost`: what accuracy costs in time, of every configuration, on one scene and machine
page  What `xfrustum cost` shows: the answers first, then the front, then everything
ways  The configurations whose cost is measured: near, depth, slabs, offset, samples, effects, tracers
"""
