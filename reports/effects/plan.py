"""The effects that a scene calls for: each used or left out, the fact that decided it, and its cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NoReturn

from xfrustum.compare.extent import require_seen
from xfrustum.reference import TRACERS
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.timing import FEWEST_DIFFERENCES
from xfrustum.reports.effects.cost_record import Cost
from xfrustum.reports.effects.depths import Depths, depths
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.arguments import whole
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, Question, decide
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.model.slabs import SlabContent, slab_contents
from xfrustum.scenes.notebook.shown import Shown, Table
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

if TYPE_CHECKING:
    from tqdm import tqdm

    from xfrustum.reports.effects.costs import Stopwatches

REPEAT = FEWEST_DIFFERENCES
"""Measured pairs of images for each effect, where costs are measured."""
DEFAULT_NEAR_PER_REACH = 1e-3
"""Near plane where none is asked for: the time does not depend on it."""

SAMPLING_NOT_ASKED = {"antialiasing": Sampling(supersample=2), "band-limiting": Sampling(aperture=4)}
"""Sampling whose cost is measured where a scene asks for none."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One effect.

    Attributes
    ----------
    name
        Name of the effect as `--effects` takes it, or of a setting of the scene.
    used
        Whether this scene's images have the effect.
    reason
        The fact that decided whether it is used.
    costs
        Cost by renderer; without an entry where it was not measured or means nothing.
    objects, out_of_sight
        Numbers of the objects that call for the effect, and of those that would if they were in sight.
    """

    name: str
    used: bool
    reason: str
    costs: dict[str, Cost]
    objects: tuple[int, ...] = ()
    out_of_sight: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True, repr=False)
class EffectsPlan(Shown):
    """The effects that one image will have, decided before anything runs, and their measured costs.

    Attributes
    ----------
    scene, aperture, settings, tracer
        Image that is asked for.
    rows
        The local effects, and then the settings of the scene.
    slabs
        Slabs of both cameras, from the back.
    depths
        Content of the aperture's frustum by depth, and what bounds its errors.
    left_out
        Cost of all local effects beyond those used, by renderer; empty if not measured.
    repeat
        Measured pairs of images; 0 if nothing was measured.
    """

    scene: Scene
    aperture: Aperture
    settings: DoubleFrustum
    tracer: str
    rows: tuple[Row, ...]
    slabs: tuple[SlabContent, ...]
    depths: Depths
    left_out: dict[str, Cost]
    repeat: int

    @property
    def drawn(self) -> tuple[SlabContent, ...]:
        """The slabs that have something in them, of the cameras that are used."""
        used = {row.name for row in self.rows if row.used}
        return tuple(slab for slab in self.slabs if slab.triangles and slab.camera.value in used)

    @property
    def passes(self) -> tuple[tuple[Camera, tuple[float, float], str], ...]:
        """Camera, heights and what is drawn of each of the rasterizer's passes, in order."""
        reflects = any(row.used for row in self.rows if row.name == Effect.REFLECTION)
        kinds = ("surfaces", "reflections") if reflects else ("surfaces",)
        return tuple((slab.camera, slab.heights, kind) for kind in kinds for slab in self.drawn)

    def _said(self) -> str:
        column, row = self.aperture.index
        used, left_out = (
            ", ".join(one.name for one in self.rows if one.used is wanted) or "nothing"
            for wanted in (True, False)
        )
        return (
            f"aperture {column},{row} of {self.scene.name!r} calls for {used}; it is drawn without {left_out}"
        )

    def _tables(self) -> Sequence[Table]:
        rows = [(one.name, "used" if one.used else "left out", one.reason) for one in self.rows]
        return (Table(head=("effect", "", "reason"), rows=rows),)


def explain(
    scene: Scene,
    aperture: Aperture | None = None,
    settings: DoubleFrustum | None = None,
    *,
    tracer: str = "embree",
    repeat: int = 0,
    progress: bool = False,
) -> EffectsPlan:
    """Say what an image of a scene calls for and, if asked, measure what each effect costs here and now.

    Parameters
    ----------
    scene
        Scene whose sampling and light transport are settings that are asked for.
    aperture, settings
        Image that is asked for; by default of the middle aperture, with both cameras and no slabs.
    tracer
        One of `xfrustum.reference.TRACERS`.
    repeat
        Measured pairs of images for each effect; 0 measures nothing, and answers from the scene alone.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        The settings make no sense for the scene, the aperture sees nothing of the objects, or there is no
        usable OpenGL.
    """
    aperture = aperture or scene.plate.middle
    settings = settings or DoubleFrustum(near=DEFAULT_NEAR_PER_REACH * scene.frustum.longest_reach)
    settings.check_against(scene.frustum)
    if whole(repeat) < 0:
        raise InputError(f"explain: repetitions must be a count from 0, not {repeat!r}")
    if tracer not in TRACERS:
        raise InputError(f"tracer must be one of {', '.join(TRACERS)}, not {tracer!r}")
    require_seen(scene, [aperture])
    question = Question(camera=settings.camera, apertures=(aperture,), settings=(settings,))
    rows = [*_local(scene, question), *_settings_of(scene, measured=repeat > 0)]
    used = frozenset(Effect(row.name) for row in rows if row.used and row.name in set(Effect))
    left_out: dict[str, Cost] = {}
    if repeat:
        # Renderers and tracers are loaded only if they are measured.
        from xfrustum.reports.effects.costs import Stopwatches  # noqa: PLC0415

        watches = Stopwatches(scene=scene, aperture=aperture, settings=settings, tracer=tracer, repeat=repeat)
        rows, left_out = _all_measured(rows, used, watches, progress)
    return EffectsPlan(
        scene=scene,
        aperture=aperture,
        settings=settings,
        tracer=tracer,
        rows=tuple(rows),
        slabs=slab_contents(scene, settings),
        depths=depths(scene, aperture, settings),
        left_out=left_out,
        repeat=repeat,
    )


def _local(scene: Scene, question: Question) -> list[Row]:
    """Return the rows of the local effects, without costs."""
    return [
        Row(
            name=one.effect,
            used=one.used,
            reason=one.reason,
            costs={},
            objects=one.objects,
            out_of_sight=one.out_of_sight,
        )
        for one in decide(scene, question=question)
    ]


def _settings_of(scene: Scene, *, measured: bool) -> list[Row]:
    """Return the rows of what changes the picture and therefore is simulated only if it is asked for.

    Where costs are measured, the reason says what the cost of a setting is that is not asked for.
    """
    sampling, transport = scene.sampling, scene.transport
    side, many = sampling.supersample, sampling.multisample
    finer = side > 1 or many > 1
    asked = {
        "antialiasing": (finer, f"{side} x {side} points a pixel and {many} coverage samples are asked for"),
        "band-limiting": (sampling.aperture > 1, f"{sampling.aperture} sub-apertures are asked for"),
        "shadows": (transport.shadows, f"asked for, with {transport.samples} light paths a pixel"),
        "interreflection": (
            transport.interreflection, f"asked for, with {transport.samples} light paths a pixel"
        ),
    }  # fmt: skip
    paths = f"{transport.samples} light paths a pixel"
    measured_as = {
        "antialiasing": "2 x 2 points a pixel",
        "band-limiting": "4 sub-apertures",
        "shadows": paths,
        "interreflection": paths,
    }

    def left_out(name: str) -> str:
        return f"not asked for{f'; the cost is that of {measured_as[name]}' if measured else ''}"

    return [
        Row(name=name, used=used, reason=reason if used else left_out(name), costs={})
        for name, (used, reason) in asked.items()
    ]


def _all_measured(
    rows: list[Row], used: frozenset[Effect], watches: Stopwatches, progress: bool
) -> tuple[list[Row], dict[str, Cost]]:
    """Return the rows with their costs, and the cost of all local effects beyond those used."""
    with progress_bar(2 * (len(rows) + 1), "explain", "measurement", shown=progress) as bar:
        costly = [replace(row, costs=_measured(row, used, watches, bar)) for row in rows]
        return costly, watches.of_effects(ALL_EFFECTS, used, bar)


def _measured(
    row: Row, used: frozenset[Effect], watches: Stopwatches, bar: tqdm[NoReturn]
) -> dict[str, Cost]:
    """Return the cost of one row: of an effect added to those used, or taken away from them."""
    if row.name in set(Effect):
        effect = Effect(row.name)
        return watches.of_effects(used | {effect}, used - {effect}, bar)
    asked = watches.scene.sampling
    if row.name == "antialiasing":
        finer = replace(asked, aperture=1) if row.used else SAMPLING_NOT_ASKED[row.name]
        return watches.of_sampling(finer, bar)
    if row.name == "band-limiting":
        return watches.of_sampling(
            Sampling(aperture=asked.aperture) if row.used else SAMPLING_NOT_ASKED[row.name], bar
        )
    transport = Transport(samples=watches.scene.transport.samples, **{row.name: True})
    return watches.of_transport(transport, bar)
