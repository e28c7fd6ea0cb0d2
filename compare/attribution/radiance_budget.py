"""The radiance error of an image, link by link: signed differences that add up (docs/method.md).

In the chain's own links, from near offset to depth, the surface points of every image are shaded
along the lines of the true frustum. Each of these links then contains only the error of *showing
another point*. The bend of the eye vector belongs to a point, not to a pixel, and is counted once:

    [light transport] -> [band limiting] -> near offset -> pivot -> fit -> slabs -> [culling]
    -> rasterization -> depth -> eye vector -> shading -> [averaging] -> clipping -> 8-bit output
"""

from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.attribution.budget import Named
from xfrustum.compare.metrics.error_maps import judged_pixels
from xfrustum.compare.metrics.radiance import Done, measure_left_out
from xfrustum.compare.prediction.chain import Chain, links_of, make_chain
from xfrustum.compare.prediction.eye_vector import drawn_lines, true_lines
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.averages import points_per_side
from xfrustum.reference.lines import crossed_frustum
from xfrustum.reference.shading import Shader
from xfrustum.scenes.appearance import Sampling, sub_apertures
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.images import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, DoubleFrustum
from xfrustum.scenes.representation import ShortRepr, through_8_bits

EYE_VECTOR, SHADING = "eye vector", "shading"
CLIPPING, OUTPUT = "clipping", "8-bit output"
TRANSPORT, BAND_LIMITING, AVERAGING = "light transport", "band limiting", "averaging"
"""Names of links.

`EYE_VECTOR` directs the eye vector at the drawn points to the camera that drew them. `SHADING`
replaces double precision: the device interpolates normals, colors and texture coordinates, and
evaluates the light model."""

MAX_CHAIN_PIXELS = 1 << 22
"""Largest number of pixels of each image of a chain: memory is some 500 bytes a pixel."""


@dataclass(frozen=True, kw_only=True)
class RadianceChange:
    """Change of linear radiance over a link or the whole chain; None without such pixels."""

    #: mean, rms and max: over all judged pixels
    mean: float | None
    rms: float | None
    max: float | None
    rms_same_triangle: (
        float | None
    )  #: over judged pixels at which all images of the chain show the same triangle
    max_same_triangle: float | None


@dataclass(frozen=True, kw_only=True)
class RadianceLink(RadianceChange, Named):
    """Radiance error added by one link, with its standard error where light is sampled."""

    standard_error: float | None


@dataclass(frozen=True, kw_only=True)
class RadianceNumbers:
    """Numbers of a `RadianceBudget`, without its images."""

    judged: int
    same_triangle: int
    links: tuple[RadianceLink, ...]
    total: RadianceChange


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RadianceBudget(ShortRepr):
    """The radiance error of one image, link by link."""

    links: tuple[str, ...]
    #: (links, H, W, 3) changes of linear RGB; a pixel without a surface is black
    steps: Floats
    #: (H, W, 3) last color minus first
    total: Floats
    #: (H, W) pixels whose truth is not a tie
    judged: Mask
    #: (H, W) judged pixels that show the same triangle in all images of the chain
    same: Mask
    #: rms standard error of links that compare with sampled light, by name of the link
    errors: dict[str, float]

    @property
    def numbers(self) -> RadianceNumbers:
        """The numbers without the images."""

        def sizes(change: Floats) -> tuple[float | None, float | None]:
            if not len(change):
                return None, None
            return float(np.sqrt(np.mean(change**2))), float(np.abs(change).max())

        def changed(change: Floats) -> RadianceChange:
            judged, same = sizes(change[self.judged]), sizes(change[self.same])
            return RadianceChange(
                mean=float(change[self.judged].mean()) if self.judged.any() else None,
                rms=judged[0],
                max=judged[1],
                rms_same_triangle=same[0],
                max_same_triangle=same[1],
            )

        return RadianceNumbers(
            judged=int(self.judged.sum()),
            same_triangle=int(self.same.sum()),
            links=tuple(
                RadianceLink(name=name, **vars(changed(step)), standard_error=self.errors.get(name))
                for name, step in zip(self.links, self.steps, strict=True)
            ),
            total=changed(self.total),
        )


def local_colors(scene: Scene, chain: Chain, side: int = 1) -> Floats:
    """Return the colors before and after each local link, (1 + links, H, W, 3) linear RGB.

    The chain's images are sampled once per pixel: T0 to R1 shaded along true lines, R1 shaded with
    the eye vector of the camera that drew each point, and R1 as the device shaded it. Each color is
    the mean over `side` x `side` of their pixels.
    """
    shader, drawn = Shader(scene), chain.images[-1]
    if drawn.color is None:
        raise ValueError("the chain's last image has no color")
    aperture = drawn.camera.aperture
    pixel_lines = crossed_frustum(scene.frustum, aperture).directions()

    def averaged(color: Floats) -> Floats:
        height, width, _ = color.shape
        boxes = color.reshape(height // side, side, width // side, side, 3)
        return np.asarray(boxes.mean(axis=(1, 3))) if side > 1 else color

    def shaded(image: HogelImage, lines: Floats) -> Floats:
        # The line through the aperture and a point in the aperture is undefined: use the line of
        # the pixel, which also meets the point.
        lines = np.where(np.isfinite(lines), lines, pixel_lines)
        return averaged(shader.picture(image.triangle, image.position.astype(np.float64), lines))

    truly = [shaded(image, true_lines(image.position, aperture)) for image in chain.images]
    bent = shaded(drawn, drawn_lines(drawn.position, scene.frustum, aperture, chain.settings))
    return np.stack([*truly, bent, averaged(drawn.color.astype(np.float64))])


def make_radiance_budget(scene: Scene, chain: Chain, done: Done = lambda: None) -> RadianceBudget:
    """Attribute the radiance error of the last image of a chain; `done` is called `steps` times."""
    truth, settings = chain.images[0], chain.settings
    aperture = truth.camera.aperture
    links, errors = [*links_of(settings), EYE_VECTOR, SHADING], dict[str, float]()
    if scene.sampling == Sampling():
        colors = local_colors(scene, chain)
    else:
        averaged = averaged_colors(scene, aperture, settings, done)
        with Rasterizer(scene) as rasterizer:
            drawn = rasterizer.render(aperture, settings, normals=False)
        assert drawn.color is not None
        colors = np.concatenate((averaged, drawn.color[None].astype(np.float64)))
        links.append(AVERAGING)
    if scene.sampling.aperture > 1:
        # Band limiting comes before the geometry, because it changes the definition of the truth
        # and not the cameras.
        links.insert(0, BAND_LIMITING)
        converged = Reference(scene).converged(aperture)
        done()
        errors[BAND_LIMITING] = converged.error
        colors = np.concatenate((converged.color[None], colors))
    if scene.transport.simulated:
        left_out = measure_left_out(scene, aperture, done).difference
        # Light paths are sampled: the link has the noise of the difference of two truths.
        errors[TRANSPORT] = float(np.sqrt(np.mean(left_out.variance_of_mean)))
        links.insert(0, TRANSPORT)
        colors = np.concatenate((colors[:1] + left_out.mean, colors))
    # Output first clips and then rounds, as the display does.
    clipped = np.clip(colors[-1:], 0.0, 1.0)
    colors = np.concatenate((colors, clipped, through_8_bits(clipped)))
    judged, numbers = judged_pixels(truth), np.stack([image.triangle for image in chain.images])
    return RadianceBudget(
        links=(*links, CLIPPING, OUTPUT),
        steps=np.diff(colors, axis=0),
        total=colors[-1] - colors[0],
        judged=judged,
        same=judged & truth.covered & (numbers == numbers[0]).all(axis=0),
        errors=errors,
    )


def steps(scene: Scene) -> int:
    """Return the number of calls of `done` by `make_radiance_budget`."""
    points, transport = scene.sampling.aperture, scene.transport
    averages = scene.sampling != Sampling()
    return points * averages + (points > 1) + 2 * points * transport.simulated


def averaged_colors(
    scene: Scene, aperture: Aperture, settings: DoubleFrustum, done: Done
) -> Floats:
    """Return `local_colors`, each the mean over the samples of pixels and aperture of a scene.

    The device's own samples (multisample) belong to the link from these colors to the device's
    image. Raises InputError if a chain would have more than `MAX_CHAIN_PIXELS`.
    """
    side = points_per_side(scene.sampling)
    width, height = scene.frustum.resolution
    if side * side * width * height > MAX_CHAIN_PIXELS:
        raise InputError(
            f"{width} x {height} pixels with {side} x {side} points each are too many; "
            f"lower frustum.resolution or sampling, to {MAX_CHAIN_PIXELS:,} points at most"
        )
    frustum = replace(scene.frustum, resolution=(side * width, side * height))
    # A finer film represents supersampling: its pixels are the samples, at the same positions.
    fine = replace(scene, frustum=frustum, sampling=Sampling())
    reference, total = Reference(fine), np.zeros(())
    points = sub_apertures(scene.plate, aperture, scene.sampling.aperture)
    with Rasterizer(fine) as rasterizer:
        for point in points:
            total = total + local_colors(
                fine, make_chain(reference, rasterizer, point, settings), side
            )
            done()
    return total / len(points)
