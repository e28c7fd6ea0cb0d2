"""Images too large for device or memory are refused before any work."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.support.scene_file import film, part
from tests.support.views import view
from xfrustum.cli.main import main
from xfrustum.raster import Rasterizer
from xfrustum.raster.device import context
from xfrustum.raster.device.context import open_context
from xfrustum.raster.rasterizer import largest_image
from xfrustum.reports.image_files import FILE_BYTES, forecast
from xfrustum.scenes import DoubleFrustum, InputError, Scene
from xfrustum.scenes.appearance import Sampling, Transport


def on_film(width: int, height: int) -> Scene:
    return view("crossing", (width, height))


def test_an_image_beyond_device_and_memory_is_a_one_line_error(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A square image with the device's longest side is too large for the device or the memory."""
    with open_context() as opened:
        longest = largest_image()
    opened.release()
    with pytest.raises(
        InputError, match=f"at most {longest} pixels along a side.* not {longest + 1} x 8;"
    ):
        Rasterizer(on_film(longest + 1, 8))
    scene, out = tmp_path / "large.toml", tmp_path / "raster.exr"
    size = film((80.0, 60.0), (81, 61), (longest, longest), (60.0, 60.0), (150.0, 150.0))
    scene.write_text(size + part("box", 20.0, (0.0, 0.0, -50.0)))
    assert main(["raster", str(scene), "--near", "1", "--out", str(out)]) == 2
    message = capfd.readouterr().err
    assert message.startswith("xfrustum: error: ") and message.count("\n") == 1
    assert "choose a smaller frustum.resolution" in message
    assert not out.exists()


def test_memory_is_checked_before_an_image_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, needed = on_film(64, 48), context.PIXEL_BYTES * 64 * 48
    monkeypatch.setattr(context, "free_memory", lambda: needed - 1)
    with pytest.raises(InputError, match=r"image of 64 x 48 pixels needs about .* GiB are free"):
        Rasterizer(scene)
    monkeypatch.setattr(context, "free_memory", lambda: needed)
    with Rasterizer(scene) as rasterizer:
        assert rasterizer.render(scene.plate.middle, DoubleFrustum(near=0.1)).covered.shape == (
            48,
            64,
        )


def test_a_large_truth_is_announced_and_a_small_one_is_not() -> None:
    assert forecast(on_film(512, 512), transported=False) is None
    text = forecast(on_film(16000, 16000), transported=False)
    assert "16000 x 16000 are 256.0 million pixels" in text
    # Bands have at most 2^19 pixels, 32 rows, for any number of processors.
    assert "traced in 500 bands" in text
    assert f"at most {16000**2 * FILE_BYTES / 2**30:.1f} GiB" in text
    # Samples and light paths count like pixels.
    averaged = replace(on_film(512, 512), sampling=Sampling(supersample=2, aperture=16))
    assert "each is the mean of 64 samples" in str(forecast(averaged, transported=False))
    lit = replace(on_film(512, 512), transport=Transport(shadows=True, samples=100))
    assert "each is the mean of 100 light paths" in str(forecast(lit, transported=True))
