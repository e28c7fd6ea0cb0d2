"""Closed forms of every error, from the truth's geometry alone.

band_limiting  Blur over a hogel's area, and the number of points it needs
chain          Chain from the truth to the raster, one change per link
depth          Depth buffers: smallest resolved separation, share of wrong pixels
displacement   Displacement: position at which each point is drawn
eye_vector     Line on which a surface point is seen, and its effect on highlights and reflections
predict        All errors of one choice of settings
reasons        Reasons for errors of prediction above a factor of 3
silhouettes    Surface errors caused by displacement and snapping along contours and creases
"""
