"""Request of `verify`: options of the user, and the validated request."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from xfrustum.compare.judging.judged import Compared, Judging
from xfrustum.compare.judging.verdict import Limits
from xfrustum.compare.renderer_model.conventions import ACCEPTABLE
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.compare.sampling import PathApertures, PlateSample, SampleRequest
from xfrustum.reference.truth import TruthBy, chosen_order
from xfrustum.reports.text import require_seen
from xfrustum.scenes import HogelImage, InputError, Scene
from xfrustum.scenes.arguments import choice, real, wholes
from xfrustum.scenes.files.pictures import Encoding
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.plate import Aperture
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

#: a renderer in Python
Renderer = Callable[[Scene, Aperture], HogelImage]


@dataclass(frozen=True, kw_only=True)
class VerifyOptions:
    """Options of `xfrustum verify`: images, conventions and limits."""

    #: program that replaces files, run for each aperture with {x}, {y}, {i}, {j} and {out}
    command: str | None = None
    #: time limit of one run, seconds, > 0
    timeout_s: float = 60.0
    #: meaning of pixel values in pictures; None selects `rgb`
    encoding: Encoding | str | None = None
    #: layout of a folder or picture (docs/layouts.md)
    layout: str | None = None
    #: columns and rows of hogels; None selects the whole plate
    apertures: Sequence[tuple[int, int]] | None = None
    #: intended near offset of the renderer, scene units
    near: float | None = None
    #: conventions in `ACCEPTABLE` that do not count as defects
    accept: Sequence[str] = ()
    #: largest share of wrong surfaces, colors or outlines in each hogel
    max_wrong: float = MAX_WRONG
    #: limit of the 99th percentile of displacement, px; None for no limit. Unknown displacement
    #: exceeds any limit.
    max_displacement_px: float | None = TOLERANCE_PX
    #: largest error in linear radiance of a color that counts as right; None: `COLOR_TOLERANCE`
    max_color: float | None = None
    #: compared property of plain pictures: `color`, or `geometry` (shown pixels and outlines)
    compare: Compared | str = Compared.COLOR
    #: model of the device that drew; None selects any device
    device: DeviceModel | None = None
    #: number of random hogels, >= 1; None selects `apertures`
    sample: int | None = None
    #: bound on the share of failing hogels, 0 to 1, at which a growing sample stops
    until: float | None = None
    #: seed of a sample
    seed: int = 0
    #: order in which the truths of a whole plate are computed; verdicts are equal
    truth_by: TruthBy | str = TruthBy.AUTO
    #: whether to keep all channels of the worst hogels
    channels: bool = False
    #: whether to draw a bar on standard error
    progress: bool = False


@dataclass(frozen=True, kw_only=True)
class Request:
    """A verification: source of images, declared conventions, hogels and limits."""

    scene: Scene
    #: pattern or path of files, or a function; None for a command
    source: str | Renderer | None
    options: VerifyOptions
    #: meaning of pixel values in pictures
    encoding: Encoding
    #: declared model of the renderer
    nominal: RendererModel
    accept: tuple[str, ...]
    limits: Limits
    #: None for chosen hogels
    sample: PlateSample | None
    #: hogels of the first look
    apertures: Sequence[Aperture]
    #: order in which truths are computed
    truth_by: TruthBy
    #: folder for relative names and the command; None: the current folder
    folder: Path | None = None

    @classmethod
    def from_options(
        cls, scene: Scene, source: str | Renderer | None, options: VerifyOptions
    ) -> Self:
        """Test all options; InputError if any is unusable, or no aperture shows an object."""
        accept = (options.accept,) if isinstance(options.accept, str) else tuple(options.accept)
        if strange := [name for name in accept if name not in ACCEPTABLE]:
            raise InputError(f"accept: {strange[0]!r} is not one of {', '.join(ACCEPTABLE)}")
        near, reach = real(options.near or 0.0), scene.frustum.longest_reach
        if not 0 <= near < reach:
            raise InputError(f"near {near} must be at least 0 and smaller than the reach, {reach}")
        if (source is None) == (options.command is None):
            raise InputError(
                "give either SOURCE, a pattern of files with {i} and {j}, or --command"
            )
        if options.layout is not None and not isinstance(source, str):
            raise InputError("layout is that of files; name their folder as SOURCE")
        if not real(options.timeout_s) > 0:
            raise InputError(f"timeout must be positive, not {options.timeout_s}")
        sample = None
        if options.sample is not None or options.until is not None:
            if options.apertures:
                raise InputError("--sample and --until draw from the whole plate: omit --apertures")
            size = SampleRequest(sample=options.sample, until=options.until, seed=options.seed)
            # Images of another renderer may show something in any hogel of the plate.
            sample = PlateSample.from_request(math.prod(scene.plate.hogels), size)
        every = scene.plate.apertures()
        chosen = _chosen(scene, options.apertures) if options.apertures else every
        require_seen(scene, chosen)
        return cls(
            scene=scene,
            source=source,
            options=options,
            encoding=choice(Encoding, options.encoding or Encoding.RGB, "encoding"),
            nominal=RendererModel(near=near),
            accept=accept,
            limits=_limits(options),
            sample=sample,
            apertures=PathApertures(scene.plate, sample.new_places(0)) if sample else chosen,
            truth_by=chosen_order(
                choice(TruthBy, options.truth_by, "truth_by"),
                scene,
                refusal="decides all hogels of a plate: leave out --apertures, --sample, --until"
                if sample or options.apertures
                else "",
            ),
        )

    @property
    def looks(self) -> int:
        """Largest number of looks; each look extends the sample of the previous look."""
        return 1 if self.sample is None else self.sample.looks

    def apertures_of(self, look: int) -> Sequence[Aperture]:
        """Return the apertures that a look adds to the sample."""
        if self.sample is None or look == 0:
            return self.apertures
        return PathApertures(self.scene.plate, self.sample.new_places(look))


def _chosen(scene: Scene, indices: Sequence[tuple[int, int]]) -> list[Aperture]:
    """Return the apertures of pairs of column and row, without repetition."""
    pairs = [wholes(index, 2) for index in indices]
    for index, pair in zip(indices, pairs, strict=True):
        if len(pair) < 2:
            raise InputError(
                f"apertures are pairs of a column and a row, such as (2, 1), not {index!r:.100}"
            )
    return [scene.plate.aperture(*pair) for pair in dict.fromkeys(pairs)]


def _limits(options: VerifyOptions) -> Limits:
    """Return the limits and the options of judging."""
    tolerance = None if options.max_color is None else real(options.max_color)
    stated: dict[str, Any] = {"color_tolerance": tolerance, "device": options.device}
    judging = Judging(
        compared=choice(Compared, options.compare, "compare"),
        **{name: value for name, value in stated.items() if value is not None},
    )
    px = options.max_displacement_px
    return Limits(wrong=options.max_wrong, displacement_px=px, judging=judging)
