"""The color of true hits.

shading       The shader of a scene: which effects and channels are computed
light         Phong on true hits, in double precision, with the true eye vector and no flips at all
surroundings  Pictures that surfaces show: textures, and the environment that they reflect
"""
