"""Closed forms of every error, from the truth's geometry alone.

band_limiting  Blur over a hogel's area, and the number of points it needs
chain          Chain from the truth to the raster, one change per link
depth          Depth buffers: smallest resolved separation, share of wrong pixels
displacement   Place where each point is drawn
eye_vector     Line on which a surface point is seen, and its effect on highlights
predict        All errors of some settings together
reasons        Reasons for errors of prediction above a factor of 3
silhouettes    Surface errors that displacement causes along contours and creases
"""
