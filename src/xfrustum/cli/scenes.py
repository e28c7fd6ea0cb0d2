"""`scenes`, `new`, `check`, `plan`, `cost`: a scene, and settings for it."""

from __future__ import annotations

from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import (
    FOLDER,
    LENGTH,
    SIZE,
    TEXT,
    flag,
    group,
    one_of,
    option,
    or_auto,
    several,
)
from xfrustum.process import say
from xfrustum.scenes.plate import DepthFormat, DepthMapping, DoubleFrustum
from xfrustum.tolerances import MAX_DEPTH_WRONG, SAMPLED_HOGELS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from xfrustum.compare.scout import AutoApertures
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate import Aperture


class _Scenes(options.Printed):
    hard = flag("List the hard cases instead.")


@options.command("xfrustum scenes")
def scenes(request: _Scenes) -> None:
    """List the built-in scenes, each with its purpose."""
    library = import_module(
        f"xfrustum.scenes.library.{'hard_cases' if request.hard else 'builtin'}"
    )
    entries = library.listing()
    width = max(len(entry.name) for entry in entries)
    request.tell(
        lambda: {
            "scenes": [
                {"name": s.name, "purpose": s.purpose, "triangles": s.triangles} for s in entries
            ]
        },
        lambda: "\n".join(
            f"{s.name:<{width}}  {s.triangles:>7,} triangles  {s.purpose}" for s in entries
        ),
    )


_PLACES = {
    "through": "Place the mesh across the plate.  [default, unless the mesh is flat]",
    "behind": "Place the whole mesh behind the plate.",
    "before": "Place the whole mesh in front of the plate.",
}


class _New(options.Printed):
    mesh: Path = options.argument(type=FOLDER)
    out = option(FOLDER, "Scene file.  [default: NAME.toml in the current folder]")
    units = option(TEXT, "Name of the length unit.  [default: m for glTF, else units]")
    size = option(
        LENGTH, "Longest side of the mesh, such as 80mm.  [default: unscaled, or to fit --plate]"
    )
    display = several(
        plate=option(
            SIZE, "Width and height of the plate, such as 600,400mm.  [default: to fit the mesh]"
        ),
        pitch=option(
            LENGTH, "Largest distance between apertures, such as 0.5mm.  [default: by --viewer]"
        ),
        viewer=option(
            LENGTH, "Viewing distance, such as 600mm, at which hogels must not be visible as cells."
        ),
    )
    up = option(one_of("yz"), "Axis of the mesh that points up.", default="y")
    places = several(**{place: flag(words) for place, words in _PLACES.items()})
    force = flag("Replace a scene file that exists.")


@options.command("xfrustum new beetle.obj --size 100 --units mm")
def new(request: _New) -> None:
    """Write a scene file whose plate, reach and field of view fit MESH."""
    from xfrustum.scenes.disk import check_mesh_file

    check_mesh_file(request.mesh)
    from xfrustum.reports.scene_check.new_scene import new_scene

    place = next((place for place in reversed(_PLACES) if request.places[place]), None)
    how: dict[str, Any] = {
        "units": request.units,
        "size": request.size,
        "force": request.force,
        "up": request.up,
    }
    written = new_scene(request.mesh, request.out, place=place, **how, **request.display)
    for feature in written.unread:
        say(f"warning: {request.mesh}: {feature}")
    if written.warning is not None:
        say(f"warning: {written.warning}")
    more = {"path": str(written.path), "pitch": written.pitch, "cells_within": written.cells_within}
    request.tell(lambda: {**asdict(written), **more}, lambda: written.sentence)


class _Check(options.Printed):
    scene = options.scene_argument
    aperture = options.aperture_option
    near = option(
        options.POSITIVE, "Near offset for which errors by depth are listed.  [default: reach/1000]"
    )
    slabs = option(options.NUMBERS, "Heights |z| at which both frusta are cut.", default=())
    viewer = option(
        LENGTH, "Viewing distance, such as 600mm: adds the near offset that a viewer notices."
    )
    out = option(FOLDER, "Folder for side.svg and top.svg.")


@options.command("xfrustum check car --viewer 600 --near 0.1 --out views")
def check(request: _Check) -> int:
    """List the place of each object, the apertures that show it, likely mistakes, and effects.

    Effects are listed if images of the aperture need them, each with the reason. Errors of near
    offset, depth buffer, shear and band limiting are listed by depth, in closed form. Exit status 1
    if no aperture of the plate shows anything.
    """
    from xfrustum.scenes import open_scene

    opened = open_scene(request.scene)
    from xfrustum.reports.scene_check import checking
    from xfrustum.reports.scene_check.effects import default_near

    options.check_out(request.out, checking.FILES)
    aperture = options.chosen_aperture(opened, request.aperture)
    near = request.near or default_near(opened)
    distance = None
    if request.viewer is not None:
        from xfrustum.compare.noticeable import scene_length

        distance = scene_length(request.viewer, opened)
    report = checking.check(
        opened, aperture, DoubleFrustum(near=near, slabs=request.slabs), distance
    )
    files = () if request.out is None else checking.write_check(report, request.out)
    for warning in report.warnings:
        say(f"warning: {warning}")
    request.tell(
        lambda: {**report.summary(), "files": [str(file) for file in files]},
        lambda: "\n".join([report.table(), *([""] if files else []), *map(str, files)]),
    )
    return 0 if report.seen else options.LIMIT_EXCEEDED


def _eyes(**values: Any) -> dict[str, Any]:
    """Return the properties of a viewer; UsageError if properties are given without a distance."""
    stated = options.present(**values)
    if stated and "viewer" not in stated:
        raise click.UsageError(
            f"{options.flag_of(next(iter(stated)))} describes a viewer: give --viewer too"
        )
    # Absent properties keep the defaults of `Viewer`.
    return stated


class _Plan(options.Measured):
    scene = options.scene_argument
    aperture = option(
        options.INDEX, "Column,row: plan for this aperture alone.  [default: the plate]"
    )
    apertures = option(
        or_auto(options.COUNT),
        "Plan for N apertures: middle, corners, then between them; auto: the worst.",
    )
    required = several(
        tolerance_px=option(
            options.POSITIVE,
            "Largest displacement of 99 % of the points, px.  [default: 0.5; with --viewer any]",
        ),
        separation=option(
            options.POSITIVE, "Least distance of two sheets drawn in order.  [default: reach/1000]"
        ),
        max_wrong=option(
            options.BELOW_1,
            "Largest share of pixels with a wrong surface due to depth.",
            default=MAX_DEPTH_WRONG,
        ),
        device=options.device_option,
    )
    eyes = group(
        _eyes,
        viewer=option(
            options.LENGTH, "Viewing distance, such as 600mm: plan a near that eyes do not notice."
        ),
        acuity_arcmin=option(
            options.POSITIVE, "Visual acuity, arc minutes.  [default: 1]", "--acuity"
        ),
        stereo_acuity_arcsec=option(
            options.POSITIVE, "Stereo acuity, arc seconds.  [default: 20]", "--stereo-acuity"
        ),
        eyes_apart_mm=option(options.POSITIVE, "Distance of the eyes, mm.  [default: 65]", "--ipd"),
        pupil_mm=option(options.POSITIVE, "Diameter of the pupils, mm.  [default: 4]", "--pupil"),
    )
    depth = option(options.one_of(DepthFormat), "Depth buffer format.  [default: any]")
    mapping = option(options.one_of(DepthMapping), "Depth mapping.  [default: any]")
    sample = option(
        options.COUNT_FROM_1,
        "Number of random hogels at which the plan is measured.",
        default=SAMPLED_HOGELS,
    )
    seed = options.seed_option
    out = option(options.FOLDER, "Folder for the page and plan.json.")

    def chosen(self, scene: Scene) -> Sequence[Aperture] | AutoApertures | None:
        """Return the apertures of the plan; None for the whole plate."""
        from xfrustum.reports.planning import spread_apertures

        if self.aperture is not None and self.apertures is not None:
            raise click.UsageError(options.ONE_OR_MANY)
        if self.aperture is None and self.apertures is None:
            return None
        # Limits of eyes hold for the whole plate: a viewer sees all hogels together.
        if self.eyes:
            raise click.UsageError(
                "a viewer sees all hogels at once: leave out --viewer, or --aperture and "
                "--apertures"
            )
        if isinstance(self.apertures, str):
            return options.auto_apertures(scene, progress=self.progress)
        aperture = options.chosen_aperture(scene, self.aperture)
        chosen = (
            [aperture] if self.apertures is None else spread_apertures(scene.plate, self.apertures)
        )
        options.look_at(scene, chosen)
        return chosen


@options.command("xfrustum plan asymmetric --viewer 400mm --out plan")
def plan(request: _Plan) -> None:
    """Plan the fewest slabs and the most robust near, and name the binding constraint on near.

    Depth buffers give a least near. The tolerance in pixels, or with --viewer the eyes at that
    distance, gives a largest near; with --viewer and --tolerance-px both limits apply. The plan is
    made for the worst apertures of the plate, and measured there and at a random sample; with
    --aperture or --apertures it is made for these apertures alone.
    """
    opened = options.open_scene(request.scene)
    from xfrustum.compare.noticeable import Viewer, scene_length
    from xfrustum.compare.planning.requirement import Requirement, depth_buffers
    from xfrustum.compare.sampling import RandomSample
    from xfrustum.raster import require_room
    from xfrustum.reports import planning

    options.check_out(request.out, planning.FILES)
    # The search takes minutes before OpenGL is needed: fail early.
    require_room(opened)
    viewer = None
    if request.eyes:
        # A viewing distance may have a unit; it is refused if the scene has no physical unit.
        distance = scene_length(request.eyes.pop("viewer"), opened)
        viewer = Viewer(distance=distance, **request.eyes)
    required = options.present(**request.required)
    # A viewer replaces the limit in pixels; with an explicit tolerance both apply.
    required["pixels_count"] = viewer is None or "tolerance_px" in required
    chosen = request.chosen(opened)
    report = planning.plan(
        opened,
        chosen,
        Requirement(**required, choices=depth_buffers(request.depth, request.mapping)),
        viewer=viewer,
        sample=RandomSample(hogels=request.sample, seed=request.seed),
        progress=request.progress,
    )
    if chosen is None:
        # Other hogels may show objects that the middle misses; the scan refuses empty plates.
        options.warn_of(opened)
    if request.out is not None:
        planning.write_plan(report, request.out)
    request.tell(report.summary, report.table)


class _Cost(options.OneOrAuto):
    tolerance_px = options.tolerance_option
    repeat = option(
        options.COUNT_FROM_1, "Timed pictures of each configuration, after a warm-up.", default=5
    )
    out = option(options.FOLDER, "Folder for the page and cost.json.")


@options.command("xfrustum cost asymmetric --repeat 1 --out cost")
def cost(request: _Cost) -> None:
    """Measure error against time of every configuration; name the cheapest within a tolerance.

    The result names the cheapest configuration for the tolerance and for a fifth of it. With
    --apertures auto, errors are measured at several apertures, and the largest error counts.
    """
    opened = options.open_scene(request.scene)
    from xfrustum.reports import cost as costs

    options.check_out(request.out, costs.FILES)
    chosen = request.chosen(opened)
    measured = costs.cost(
        opened, chosen, request.tolerance_px, repeat=request.repeat, progress=request.progress
    )
    if request.out is not None:
        costs.write_cost(measured, request.out)
    request.tell(measured.summary, measured.table)
