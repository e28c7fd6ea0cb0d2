"""The color of true hits.

environment    The environment that surfaces reflect: radiance by direction, from a latitude-longitude map
interpolation  Normals, colors and textures between vertices, interpolated linearly in space
shading        Phong on true hits, in double precision, with the true eye vector and no flips at all
textures       Pictures on surfaces: decoded from sRGB, then bilinear between texel centers, repeated, no
               mipmaps
"""
