"""Mistakes of renderers whose hogels are put together from views.

view_shear  The shear of views: views that were registered at another plane than the plate
"""
