"""Model of a foreign renderer: conventions, geometry, and the images of this model.

| module | holds |
| --- | --- |
| `conventions` | conventions that an author may declare, and the eight symmetries of a grid |
| `drawn_model` | the model: conventions, parameters, composition, film |
| `pictures` | images of a model, and the surface points that they show |
"""
