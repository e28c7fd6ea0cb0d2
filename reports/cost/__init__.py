"""What accuracy costs in time: the one place where settings are timed.

cost       `xfrustum cost`: error and time of every configuration, on one scene and machine
page       What `xfrustum cost` shows: the answers first, then the front, then everything
trade_off  Which configurations are worth their time, and which is the cheapest within a tolerance
"""
