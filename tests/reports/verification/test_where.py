"""Where wrong pixels are: by what image and truth show there."""

import numpy as np

from tests.support.foreign_renderers import oblong, saying
from xfrustum.compare.judging.judged import judge
from xfrustum.compare.judging.where import places_of
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.compare.renderer_model.pictures import colored, trace_drawn
from xfrustum.reference import Reference
from xfrustum.scenes import NOTHING


def test_a_plain_picture_shows_what_is_not_black() -> None:
    """Colors that are wrong in all of a picture but its black corner."""
    scene, right = oblong(), RendererModel()
    reference = Reference(scene)
    truth = trace_drawn(reference, right, scene.plate.aperture(2, 2))
    picture = saying(colored(scene, right, truth), "color")
    assert picture.color is not None
    picture.color[...] = np.random.default_rng(0).uniform(0.1, 1.0, picture.color.shape)
    picture.color[:12, :16] = 0.0
    places = places_of(judge(reference, right, picture, picture.position.astype(np.float64)))
    wrong, _ = places["shown/nothing"]
    assert wrong == (truth.triangle[:12, :16] != NOTHING).sum() > 0
