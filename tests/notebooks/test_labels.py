"""Images as labelled arrays: channels, positions and signs."""

import sys

import numpy as np
import pytest

from tests.support.worlds import World
from xfrustum import InputError, compare_images

pytest.importorskip(
    "xarray", reason="needs the package xarray, the optional part xfrustum[notebook]"
)


def test_a_labelled_truth_has_the_images_channels_and_places_its_points(
    recentered: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth = recentered.truth((0, 2))
    labelled = truth.to_xarray()
    for name in ("triangle", "object", "height", "position", "normal", "color", "certainty"):
        assert np.array_equal(labelled[name].values, getattr(truth, name), equal_nan=True)
    assert "variance" not in labelled and "settings" not in labelled.attrs
    assert labelled.height.attrs == {"long_name": "height above the plate", "units": "scene units"}
    # The line of a pixel (CONVENTIONS.md): its point is a + s d with s = -z.
    for axis, (shear, half_extent, place, film) in enumerate(
        zip(labelled.attrs["shear"], labelled.attrs["half_extent"], "xy", "uv", strict=True)
    ):
        at = labelled[place] - labelled.height * (shear + labelled[film] * half_extent)
        # Points are doubles: errors of a few units in the 14th digit.
        assert float(abs(at - labelled.position[..., axis]).max()) < 1e-9
    assert labelled.height.notnull().any()
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(InputError, match=r"pip install '\.\[notebook\]'"):
        truth.to_xarray()


def test_labelled_errors_have_the_signs_of_the_maps(centered: World) -> None:
    """A point at z is drawn at u |z|/(|z| + n): true minus drawn points away from the middle."""
    comparison = compare_images(centered.truth(), centered.raster(), centered.reference)
    labelled = comparison.to_xarray(units="mm")
    for moved, film in (
        (labelled.displacement_columns, labelled.u),
        (labelled.displacement_rows, -labelled.v),
    ):
        assert float((moved * np.sign(film)).where(abs(film) > 0.1).min()) > 0
        assert moved.attrs["units"] == "px"
    assert int(labelled.surface.sum()) == comparison.surface_wrong
    assert labelled.radiance_error.dims == ("v", "u", "rgb")
