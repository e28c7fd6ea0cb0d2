"""What accuracy costs in time: the one place where settings are timed.

cost       `xfrustum cost`: what accuracy costs in time, of every configuration, on one scene and machine
page       What `xfrustum cost` shows: the answers first, then the front, then everything
trade_off  Error against time: which configurations are worth it, and which is the cheapest within a
           tolerance
ways       The configurations whose cost is measured: near, depth, slabs, offset, samples, effects, tracers
"""
