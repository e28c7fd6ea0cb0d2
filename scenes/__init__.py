"""The question: plate, frustum, meshes, settings, and the image that every renderer returns."""
