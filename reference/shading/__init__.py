"""Color of true hits.

* shading: the shader of a scene, with its effects and channels
* light: Phong on true hits in double precision, with textures and the environment
"""
