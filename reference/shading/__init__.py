"""The color of true hits.

environment    The environment that surfaces reflect: radiance by direction, from a latitude-longitude map
interpolation  Normals, colors and texture coordinates between vertices, interpolated linearly in space
light          Phong on true hits, in double precision, with the true eye vector and no flips at all
shading        The shader of a scene: effects, channels, and points given in NumPy's arrays
textures       Pictures on surfaces: decoded from sRGB, then bilinear between texel centers, repeated, no
               mipmaps
"""
