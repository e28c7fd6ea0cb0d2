"""Closed forms of every error, from the truth's geometry alone.

band_limiting  Blur over a hogel's area, and the number of points it needs
depth          Depth buffers: smallest resolved separation, share of wrong pixels
displacement   Place at which each point is drawn, and the line on which it is seen
predict        The chain from the truth to the raster, and all errors of one choice of settings
reasons        Reasons for errors of prediction above a factor of 3
silhouettes    Surface errors caused by displacement and snapping along contours and creases
"""
