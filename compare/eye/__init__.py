"""Losses in views of a plate, and the near offset that a viewer notices.

* loss: views replayed to an eye, and the losses of the display and of a renderer
* noticeable: replayed places of drawn points, and closed forms of noticeable effects
"""
