"""The section of a page that shows where a scene lies, for `_scene.html.j2`."""

from __future__ import annotations

from dataclasses import dataclass

from markupsafe import Markup

from xfrustum.compare.extent_words import warnings
from xfrustum.reports.scene_check.drawing import NAMESPACE, draw_view
from xfrustum.reports.scene_check.picture_frame import View
from xfrustum.scenes.model.scene import Scene


@dataclass(frozen=True, kw_only=True)
class SceneFit:
    """What the section shows.

    Attributes
    ----------
    views
        The side view and the top view, SVG.
    warnings
        What the reach cuts off and which objects are tiny, one sentence each.
    """

    views: tuple[Markup, ...]
    warnings: tuple[str, ...]


def scene_fit(scene: Scene) -> SceneFit:
    """Draw a scene's views and collect its warnings."""
    # A page knows what svg is, and names no address.
    views = (draw_view(scene, view).replace(f' xmlns="{NAMESPACE}"', "", 1) for view in View)
    return SceneFit(views=tuple(Markup(text) for text in views), warnings=warnings(scene))
