"""What a viewer notices of a plan: what its requirement promises, and what a replay shows to two eyes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from xfrustum.compare.eye.loss import DepthShift, Views, disparity, renderer_loss
from xfrustum.compare.eye.noticeable import Display, Viewer, blur_arcmin, eyes_apart, replay_noise_arcsec
from xfrustum.compare.eye.shown import Collector, collected, film_parts, hogels_of
from xfrustum.compare.planning.plan import Plan
from xfrustum.compare.planning.viewer import CRACK, STEREO, EyeRequirement, NearLimit, binding
from xfrustum.compare.prediction.chain import with_exact_depth
from xfrustum.compare.sampling import CONFIDENCE, share_at_most
from xfrustum.reference.eye.view import EyeReference
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.eye.view import Drawing, stereo_eyes
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.eye import Eye
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook import digits, percent
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

FILM_COLUMNS = 64
"""Columns of the films of both eyes: of no more hogels than pixels a part is drawn."""


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """What two eyes are shown of drawn hogels, measured."""

    hogels: int  #: Number of hogels of which pixels were drawn
    matched: int  #: Number of surface points that both eyes are shown
    #: Largest difference of the changes of disparity of two points, or of one and the plate's border, from
    #: the 1st to the 99th percentile; None where both eyes are shown no point
    disparity_change_arcsec: float | None
    depth: DepthShift | None  #: By how much farther away than they are points are seen, scene units
    #: Share of both eyes' judged pixels with a wrong surface, and share of those right with exact depth
    wrong: float
    depth_wrong: float
    judged: int  #: Number of both eyes' judged pixels

    @property
    def depth_wrong_at_most(self) -> float:
        """Upper bound of the share that is wrong by depth, as if pixels were drawn at random."""
        return share_at_most(round(self.depth_wrong * self.judged), self.judged)


class ReplayWorkbench:
    """Two eyes straight before a scene's plate, what they truly see, and what they are shown.

    Their films have so many columns; rows follow from the plate.
    """

    def __init__(self, scene: Scene, viewer: Viewer, columns: int = FILM_COLUMNS) -> None:
        self._scene = scene
        self._reference = EyeReference(scene)
        width, height = scene.plate.size
        film = (columns, max(1, round(columns * height / width)))
        middle = Eye(position=(0.0, 0.0, viewer.distance), resolution=film)
        self._views = [
            Views(
                true=self._reference.true_view(eye, shaded=False),
                replayed=self._reference.replayed(eye, shaded=False),
                drawn=None,
                taken=self._reference.replay(eye),
            )
            for eye in stereo_eyes([middle], eyes_apart(viewer, Display.of(scene)))
        ]
        self._control: tuple[DoubleFrustum, list[Mask]] | None = None

    @property
    def eye_pixel(self) -> float:
        """Width that a pixel of the eyes' films has on the plate, scene units."""
        return self._scene.plate.size[0] / self._views[0].eye.resolution[0]

    @property
    def hogels(self) -> int:
        """Number of hogels that the eyes are shown."""
        return len(hogels_of(view.taken for view in self._views))

    def measure(
        self, settings: DoubleFrustum, done: Callable[[int], object] = lambda hogels: None
    ) -> Replayed:
        """Draw what the eyes are shown of hogels with some settings, and with exact depth, and judge both.

        Settings that differ in their depth buffers alone share the pictures of exact depth.
        """
        exact = with_exact_depth(settings)
        if self._control is None or self._control[0] != exact:
            self._control = exact, self._wrong(self._drawn(exact))
            done(self.hogels)
        views = self._drawn(settings)
        done(self.hogels)
        wrong = self._wrong(views)
        judged = sum(one.size for one in wrong)
        by_depth = sum(int((a & ~b).sum()) for a, b in zip(wrong, self._control[1], strict=True))
        _, pair = disparity(self._reference, *views)
        assert pair is not None
        change = pair.change_arcsec
        return Replayed(
            hogels=self.hogels,
            matched=pair.matched,
            disparity_change_arcsec=None if change is None else max(change.p99, 0.0) - min(change.p1, 0.0),
            depth=pair.depth,
            wrong=sum(int(one.sum()) for one in wrong) / judged,
            depth_wrong=by_depth / judged,
            judged=judged,
        )

    def _drawn(self, settings: DoubleFrustum) -> list[Views]:
        collectors = [Collector(self._scene, view.eye, view.taken, settings) for view in self._views]
        hogels = Drawing(self._scene, settings).hogels(film_parts(view.taken for view in self._views))
        images = collected(hogels, collectors)
        return [replace(view, drawn=image) for view, image in zip(self._views, images, strict=True)]

    def _wrong(self, views: Sequence[Views]) -> list[Mask]:
        """Return the judged pixels that show a wrong surface, for each eye."""
        found = []
        for view in views:
            maps = renderer_loss(self._reference, view, numbered=True)
            assert maps.wrong is not None
            found.append(maps.wrong[maps.judged])
        return found


@dataclass(frozen=True, kw_only=True)
class PlannedRecord:
    """What `plan --viewer` adds: the key `viewer` of the JSON object."""

    viewer: Viewer
    #: Blurs of the display: of pitch, and of pixels and diffraction at the farthest surface
    pitch_arcmin: float
    pixel_arcmin: float
    diffraction_arcmin: float
    rays_per_pupil: float | None  #: Pixels of a hogel that a pupil catches along an axis
    #: What the viewer may notice of a near without cuts, and how large near may be for each
    limits: tuple[NearLimit, ...]
    binding: str | None  #: Name of the limit that leaves the smallest near; None where no near is noticed
    #: Predicted of the plan: change of disparity, and width of the crack in a surface that runs through the
    #: plate; None without a plan, and without such a surface
    stereo_change_arcsec: float | None
    crack_arcmin: float | None
    separation: float | None  #: Distance of sheets that must be ordered, scene units
    separation_limited_by: str | None  #: What decides it; None where it was asked for
    measured: Replayed | None  #: What a replay of the plan shows to two eyes; None without a plan
    #: The same with the plan's cuts; None without a plan, and where it has no cuts
    limits_with_cuts: tuple[NearLimit, ...] | None = None
    #: By how much the replay's change of disparity may differ from that of a finer display and finer eyes
    #: (`replay_noise_arcsec`); None without a plan
    noise_arcsec: float | None = None
    #: What the replay shows beyond what is required, in words: empty where nothing, and without a plan
    exceeded: tuple[str, ...] = ()


def exceeded(found: Replayed, requirement: EyeRequirement, noise_arcsec: float) -> tuple[str, ...]:
    """Return what a replay shows beyond what a viewer requires, in words.

    A change of disparity counts where it is beyond stereo acuity by more than the replay's own noise: a plan
    takes the largest near that is not noticed, so that acuity itself is what its replay shows.
    """
    parts = []
    change, acuity = found.disparity_change_arcsec, requirement.viewer.stereo_acuity_arcsec
    if change is not None and change > acuity + noise_arcsec:
        parts.append(
            f"two eyes see depths off by {digits(change)} arc seconds of disparity, more than "
            f"{digits(acuity)} and the replay's noise of {digits(noise_arcsec)}"
        )
    if found.depth_wrong > requirement.max_wrong:
        parts.append(
            f"{percent(found.depth_wrong)} of {found.judged:,} pixels are wrong by depth, more than "
            f"{percent(requirement.max_wrong)}"
        )
    return tuple(parts)


def replayed_plan(made: Plan, record: PlannedRecord) -> Plan:
    """Return a plan that holds only where its replay does too."""
    if not record.exceeded:
        return made
    reason = f"{made.reason} But replayed it does not hold: {' and '.join(record.exceeded)}."
    return replace(made, within=False, reason=reason)


def planned_record(
    scene: Scene, made: Plan, requirement: EyeRequirement, *, progress: bool = False
) -> PlannedRecord:
    """Return what a viewer notices of a plan that was made for his eyes, measured by a replay.

    `replayed_plan` has what follows for the plan.
    """
    settings, viewer, display = made.settings, requirement.viewer, requirement.display
    farthest = max(requirement.content.farthest, key=abs, default=0.0)
    blurs, binds, limit = (
        blur_arcmin(farthest, viewer, display),
        binding(requirement.limits),
        requirement.separation_limit,
    )
    rays = None
    if display.millimeters is not None:
        rays = viewer.pupil_mm / display.millimeters / (viewer.distance * display.pixel)
    measured, noise, with_cuts = None, None, None
    beyond: tuple[str, ...] = ()
    noticed: dict[str, float] = {}
    if settings is not None:
        noticed = {name: there for name, (there, _, _) in requirement.noticed(settings).items()}
        workbench = ReplayWorkbench(scene, viewer)
        with progress_bar(None, "eyes", "hogel", shown=progress) as bar:
            measured = workbench.measure(settings, bar.update)
        noise = replay_noise_arcsec(requirement.content, viewer, display, settings, workbench.eye_pixel)
        beyond = exceeded(measured, requirement, noise)
        with_cuts = requirement.limits_with(settings) if settings.slabs else None
    return PlannedRecord(
        viewer=viewer,
        pitch_arcmin=blurs["pitch"],
        pixel_arcmin=blurs["pixel"],
        diffraction_arcmin=blurs["diffraction"],
        rays_per_pupil=rays,
        limits=requirement.limits,
        binding=None if binds is None else binds.name,
        stereo_change_arcsec=noticed.get(STEREO),
        crack_arcmin=noticed.get(CRACK),
        separation=requirement.separation,
        separation_limited_by=None if limit is None else limit[0],
        measured=measured,
        limits_with_cuts=with_cuts,
        noise_arcsec=noise,
        exceeded=beyond,
    )


def planned_table(record: PlannedRecord, units: str) -> str:
    """Return the same as lines of text."""
    viewer = record.viewer
    lines = [
        f"for a viewer at {digits(viewer.distance)} {units}, eyes {digits(viewer.eyes_apart_mm)} mm apart:"
    ]
    lines += _limit_lines(record.limits, "without cuts", units)
    if record.limits_with_cuts is not None:
        lines += _limit_lines(record.limits_with_cuts, "with these cuts", units)
    found = record.measured
    if found is None:
        return "\n".join(lines)
    if record.stereo_change_arcsec is not None and found.disparity_change_arcsec is not None:
        lines.append(
            f"  two eyes see depths off by {digits(record.stereo_change_arcsec)} arc seconds of disparity; "
            f"replayed, {digits(found.disparity_change_arcsec)} ({found.matched:,} points), which is known "
            f"to within {digits(record.noise_arcsec or 0.0)}"
        )
    lines.append(
        f"  replayed, {percent(found.depth_wrong)} of what both eyes are shown is wrong by depth "
        f"({found.judged:,} pixels of {found.hogels:,} hogels; at most {percent(found.depth_wrong_at_most)}, "
        f"with a confidence of {percent(CONFIDENCE)})"
    )
    return "\n".join([*lines, *(f"  beyond what is required: {one}" for one in record.exceeded)])


def _limit_lines(limits: Sequence[NearLimit], cuts: str, units: str) -> list[str]:
    """Return a line for each thing that a viewer may notice, with the largest near that he does not."""
    found, lines = binding(limits), []
    for limit in limits:
        if limit.largest_near is None:
            largest = "any near"
        else:
            largest = f"near up to {limit.largest_near:g} {units}" if limit.largest_near else "no near"
        if limit.name == CRACK:
            what = f"the crack at the plate, {digits(limit.allowed)} arc minutes ({limit.hidden_by})"
        else:
            what = f"change of depth, {digits(limit.allowed)} arc seconds of disparity"
        binds = "  <- binds" if limit == found else ""
        lines.append(f"  {f'{cuts}: {what}':<82}  {largest}{binds}")
    return lines
