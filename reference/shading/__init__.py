"""The color of true hits.

shading  The shader of a scene: which effects and channels are computed
light    Phong on true hits, in double precision, with textures and the environment
"""
