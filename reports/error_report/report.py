"""`xfrustum report`: measures a scene over settings, and writes page, numbers and inspection.

Its index.html, report.json, measurements.parquet and inspect.html appear together or not at all.
"""

import hashlib
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from xfrustum.compare.comparison import PIXELS_PER_DEGREE
from xfrustum.compare.error_maps import CONFIDENCE
from xfrustum.compare.sampling import is_beyond
from xfrustum.compare.scout import FILM_PIXELS, AutoApertures
from xfrustum.reference import alone
from xfrustum.reports import inspection
from xfrustum.reports.common import outputs, pictures
from xfrustum.reports.common.outputs import Staging, json_object
from xfrustum.reports.common.records import table_of
from xfrustum.reports.common.templates_environment import address, html_page
from xfrustum.reports.error_report import best as choosing
from xfrustum.reports.error_report.best import (
    FIGURES,
    GEOMETRY,
    GEOMETRY_FIGURES,
    SHADED_FIGURES,
    SURFACE_TIE_FRACTION,
    Measurement,
    Recommendation,
    RowNumbers,
    Window,
    best_per_depth,
    best_per_geometry,
    best_setting,
    by_depth,
    can_be_judged,
    cause_figure,
    equally_good,
    geometries_of,
    geometry_of,
    pair_figure,
)
from xfrustum.reports.error_report.sweep import (
    LEFT_OUT,
    LightReport,
    ReportOptions,
    Sweep,
    settings_of,
    sweep,
)
from xfrustum.reports.inspection import Inspection, PlateMap
from xfrustum.reports.plotting import Figure, choices, map_figures, scout_record
from xfrustum.reports.scene_check.checking import scene_fit
from xfrustum.reports.text import (
    CERTAINTY_LABELS,
    DISPLACEMENT_TIE_PX,
    SENTENCES,
    displacement_words,
    pixels,
    require_seen,
)
from xfrustum.scenes import Aperture, DoubleFrustum, InputError, Offset, Pivot
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.representation import counted, digits, percent
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

KINDS = ("html", "json", "parquet", "inspection")
FILES = ("index.html", "report.json", "measurements.parquet", inspection.PAGE)
"""Names of the files of a report, in the order of `KINDS`."""

#: largest number of hogels that the recommendation names
MAX_NAMED_HOGELS = 5


@dataclass(frozen=True, kw_only=True)
class ReportFiles:
    """Files of a report, and its results."""

    html: Path
    json: Path
    parquet: Path
    inspection: Path
    #: best setting with its numbers at the worst aperture
    best: Recommendation
    #: description of that setting
    sentence: str
    #: command that draws with this setting
    command: str
    #: object in report.json
    content: dict[str, Any]
    #: sentences on the measured share of the plate and on omitted parts; `cost` states the times
    notes: tuple[str, ...]
    cost: str

    @property
    def places(self) -> dict[str, Path]:
        """Paths of all files by their kind."""
        return {kind: getattr(self, kind) for kind in KINDS}


def default_folder(scene: Scene) -> Path:
    """Return the default folder of a report: `report/NAME` in the current folder."""
    name = re.sub(r"[^\w.-]+", "-", scene.name).strip("-.") or "scene"
    return Path("report") / name


def make_report(
    scene: Scene, out: Path | str | None = None, options: ReportOptions | None = None
) -> ReportFiles:
    """Measure the error of a scene over settings and write page, numbers and inspection.

    The files go into the folder `out`, by default `default_folder`. No file appears before all
    files are complete.

    InputError if a setting makes no sense, there is nothing to measure or to see, the folder cannot
    be written, or there is no OpenGL.
    """
    options = options or ReportOptions()
    places = scene.default_apertures() if options.apertures is None else options.apertures
    if isinstance(places, AutoApertures):
        places = places.apertures
    apertures = tuple(dict.fromkeys(places))
    settings = settings_of(scene.frustum, options)
    if not settings or not apertures:
        raise InputError(
            "nothing to measure: give at least one near, one depth format and one aperture"
        )
    require_seen(scene, apertures)
    with Staging(default_folder(scene) if out is None else Path(out), FILES) as staging:
        measured = sweep(scene, apertures, settings, options)
        rows = _row_numbers(measured)
        content = report_content(measured, rows)
        notes = _notes(measured)
        html, json, parquet, _ = FILES
        staging.write(html, render_page(measured, content, notes))
        staging.write(json, content)
        pq.write_table(table_of(RowNumbers, rows), (staging.folder / parquet).absolute())
        inspection.write_inspection(staging.folder, _inspected(measured))
        staging.commit()
    return ReportFiles(
        **{kind: staging.out / name for kind, name in zip(KINDS, FILES, strict=True)},
        best=measured.best,
        sentence=content["best"]["sentence"],
        command=content["best"]["command"],
        content=content,
        notes=tuple(filter(None, [notes["coverage"], notes["left_out"], *_missed_light(measured)])),
        cost=notes["cost"],
    )


def _inspected(measured: Sweep) -> Inspection:
    """Return the content of the inspection page: the apertures drawn with the best setting."""
    settings, plate = measured.best.settings, measured.scene.plate
    rows = [row for row in measured.rows if row.settings == settings]
    shares = [(*row.aperture.index, row.surface_fraction) for row in rows]
    drawn = f"near {digits(settings.near)}, {settings.depth_label}"
    return Inspection(
        command="report",
        scene=measured.scene,
        intro=f"The apertures of the report, drawn with its best setting: {drawn}.",
        hogels=measured.inspected,
        plate_map=PlateMap.from_values(plate, "Share of wrong surfaces", shares),
    )


# Numbers
# --------------------------------------------------------------------------------------------------


def _row_numbers(measured: Sweep) -> list[RowNumbers]:
    """Return the rows of the table, with scene, versions and devices in `made_by`."""
    scene = measured.scene
    made_by = {
        "scene_name": scene.name,
        "scene_source": scene.source,
        "scene_hash": scene.content_hash,
        "units": scene.units,
        "decided_by": measured.decided_by,
        **{f"version_{name}": version for name, version in measured.versions.items()},
        **{f"device_{name}": value for name, value in measured.devices.items()},
    }
    return [row.numbers(scene.frustum.longest_reach, made_by) for row in measured.rows]


def report_content(measured: Sweep, rows: Sequence[RowNumbers]) -> dict[str, Any]:
    """Return the record of report.json."""
    scene, reach, best = measured.scene, measured.scene.frustum.longest_reach, measured.best

    def recommended(choice: Recommendation) -> dict[str, Any]:
        names = ("surface_fraction", "displacement_p99_px", "radiance_fraction", "window")
        return {
            **json_object(choice.settings),
            "near_per_reach": choice.settings.near / reach,
            **{name: getattr(choice, name) for name in names},
            # The aperture with most wrong surfaces.
            "aperture": choice.aperture.index,
        }

    sentence = recommendation(
        measured.rows, scene.units, reach, recentered=scene.frustum.recentered
    )
    if measured.decided_by != alone.CERTIFIED:
        note = outputs.unexamined_truth(measured.decided_by)
        sentence = f"{sentence.removesuffix('.')} ({note})."
    numbers = [{**json_object(row), "aperture": row.aperture.index} for row in rows]
    for row, source in zip(numbers, measured.rows, strict=True):
        # Remove columns that report.json lacks, or has in another form.
        del row["made_by"], row["causes"]
        row["causes"] = source.causes
    record = {
        "scene": {
            "name": scene.name,
            "source": scene.source,
            "hash": scene.content_hash,
            "units": scene.units,
            "objects": len(scene.objects),
            "triangles": len(scene.faces),
            "plate": scene.plate,
            "frustum": scene.frustum,
        },
        "apertures": measured.apertures,
        "best": {
            "sentence": sentence,
            **recommended(best),
            "command": outputs.raster_command(scene, best.aperture, best.settings),
            "plan_command": outputs.scene_command("plan", scene),
            "confidence": CONFIDENCE,
        },
        "best_per_depth": list(map(recommended, best_per_depth(measured.rows))),
        "best_per_geometry": list(map(recommended, best_per_geometry(measured.rows))),
        "rows": numbers,
        # If an uncertified tracer made the truths, there is nothing to compare it with.
        "tracers_alone": [
            {"aperture": aperture.index, **json_object(truth.alone)}
            for aperture, truth in zip(measured.apertures, measured.truths, strict=True)
            if truth.alone is not None
        ],
        **{
            name: getattr(measured, name)
            for name in ("decided_by", "versions", "devices", "device_model", "times_s")
        },
        "cost": {
            "wall_s": measured.wall_s,
            "frames_s": measured.times_s["raster"],
            "truths_s": measured.times_s["trace"],
            "pictures_s": measured.times_s["pictures"],
        },
        "shading": measured.light and _light_record(measured.light, measured),
        "scout": scout_record(measured.auto) if measured.auto else None,
        "left_out": () if measured.options.causes else LEFT_OUT,
    }
    return json_object(record)


def _light_record(light: LightReport, measured: Sweep) -> dict[str, Any]:
    return {
        "effects": measured.options.effects,
        "decisions": [
            {"effect" if key == "name" else key: value for key, value in vars(row).items()}
            for row in light.decisions
        ],
        "same_bits": light.same_bits,
        "sampling": measured.scene.sampling,
        "eye_vector": light.eye,
        "left_out": [
            {"aperture": part.aperture.index, **json_object(part.numbers)} for part in light.missed
        ],
    }


# Sentences
# --------------------------------------------------------------------------------------------------


def geometry_names(geometries: Sequence[DoubleFrustum]) -> dict[DoubleFrustum, str]:
    """Return a distinct name of each geometry.

    A single geometry is named by its unusual parts, such as `pivot camera, no offset`, if any.
    """
    # Any near serves, because only the geometry is compared.
    usual = DoubleFrustum(near=1.0)
    compared = geometries if len(geometries) > 1 else (*geometries, usual)
    varied = [name for name in GEOMETRY if len({getattr(each, name) for each in compared}) > 1]

    def words(geometry: DoubleFrustum) -> str:
        heights = " and ".join(map(digits, geometry.slabs))
        fit = digits(geometry.fit) if isinstance(geometry.fit, float) else geometry.fit
        phrases = {
            "pivot": f"pivot {geometry.pivot}",
            "fit": "usual fit" if fit is None else f"fit {fit}",
            "offset": "no offset" if geometry.offset is Offset.NONE else "offset to the plate",
            "slabs": f"cuts at {heights}" if heights else "no cuts",
        }
        return ", ".join(phrases[name] for name in varied)

    return {geometry: words(geometry) for geometry in geometries}


def recommendation(
    rows: Sequence[Measurement], units: str, reach: float, *, recentered: bool = True
) -> str:
    """Return the recommendation: the best near planes and depth buffer, with their errors.

    `units` is the scene's unit of length, and `reach` the scene's longer reach in this unit. The
    pivot of a frustum without recentering, and therefore without shear, has no effect and is not
    named.
    """
    # Unique indices in the order of measurement.
    indices = dict.fromkeys(row.aperture.index for row in rows)
    named = "; ".join(f"{column},{row}" for column, row in list(indices)[:MAX_NAMED_HOGELS])
    named += "; .." if len(indices) > MAX_NAMED_HOGELS else ""
    where = f"At hogel {named}:" if len(indices) == 1 else f"At {len(indices)} hogels ({named}):"
    if not can_be_judged(rows):
        return (
            f"{where} there is nothing to judge: all pixels of the truth are ties, "
            "or neither the truth nor any raster image shows a surface."
        )
    best = best_setting(rows)

    def cameras_of(settings: DoubleFrustum) -> DoubleFrustum:
        return settings if recentered else replace(settings, pivot=Pivot.APERTURE)

    names = geometry_names(geometries_of(cameras_of(row.settings) for row in rows))
    cameras = names[geometry_of(cameras_of(best.settings))]
    near = f"{digits(best.settings.near)} {units}"
    parts = [
        f"{where} {_praise(best, rows)} near {near_range(best.window)} {units} "
        f"({near_range(best.window, reach)} of the reach) with {best.settings.depth_label} depth"
        + (f" and {cameras}" if cameras else "")
    ]
    if best.window.nears > 1:
        parts.append(f"; the {best.window.nears} nears measured there are equally good. At {near}")
        parts.append(", ")
    else:
        parts.append(". ")
    parts.append(f"{_wrong(best, rows)}, ")
    if best.radiance_fraction is not None:
        parts.append(
            f"{percent(best.radiance_fraction)} are off in color by more than a level of 255, "
        )
    parts.append(f"and {displacement_words(best.displacement_p99_px)}")
    if best.displaced_aperture != best.aperture and best.displacement_p99_px > DISPLACEMENT_TIE_PX:
        parts.append(" (the worst at {},{})".format(*best.displaced_aperture.index))
    parts.append(".")
    # An empty gap is neither a displacement nor a wrong surface: the errors do not show it.
    if best.settings.offset is Offset.NONE:
        parts.append(
            " The cameras stay in the aperture and clip all that is closer than near: a gap of "
            f"{near} on each side of the plate."
        )
    return "".join(parts)


def _praise(best: Recommendation, rows: Sequence[Measurement]) -> str:
    """Return the rating of the best setting by the tolerances."""
    every = {row.settings for row in rows}
    beyond = {
        row.settings
        for row in rows
        if is_beyond(row.displacement_p99_px, row.surface_fraction, TOLERANCE_PX)
    }
    praise = f"best of {len(every)} settings" if len(every) > 1 else "the one setting measured"
    if best.settings in beyond:
        praise += f", though beyond {TOLERANCE_PX:g} px or {percent(MAX_WRONG)} wrong surfaces"
        praise += "" if every == beyond else " (others are within)"
    return f"{praise}:"


def _wrong(best: Recommendation, rows: Sequence[Measurement]) -> str:
    """Return the share of wrong surfaces, its aperture, and the cause if one prevails."""
    apertures = len({row.aperture for row in rows})
    share = f"{percent(best.surface_fraction)} of the judged pixels show the wrong surface"
    if apertures > 1:
        column, row = best.aperture.index
        share += f" at the worst of {apertures} apertures ({column},{row})"
    causes = next(
        row.causes
        for row in rows
        if row.settings == best.settings and row.aperture == best.aperture
    )
    wrong = sum(cause.surface for cause in causes)
    # A cause is named only with a majority of the wrong pixels; otherwise the name misleads.
    most = next((cause.name for cause in causes if 2 * cause.surface > wrong), None)
    if best.surface_fraction <= SURFACE_TIE_FRACTION or most is None:
        return share
    return f"{share}, most of them charged to {most}"


def near_range(window: Window, unit: float = 1.0) -> str:
    """Write the ends of a window as multiples of a length."""
    ends = dict.fromkeys((window.low, window.high))
    return " to ".join(digits(end / unit) for end in ends)


def _notes(measured: Sweep) -> dict[str, str]:
    """Return additional sentences for the recommendation; empty where they do not apply."""
    scene, rows, notes = measured.scene, measured.rows, {}
    count, hogels = len(measured.apertures), math.prod(scene.plate.hogels)
    notes["coverage"] = notes["left_out"] = notes["equally_good"] = ""
    if count < hogels:
        notes["coverage"] = (
            f"Measured at {count:,} of {hogels:,} hogels, and others may need other settings: "
            f"{outputs.scene_command('plan', scene)} says what holds for the whole plate."
        )
    if not measured.options.causes:
        notes["left_out"] = (
            f"Left out on request: {', '.join(LEFT_OUT[:-1])} and {LEFT_OUT[-1]}. Wrong pixels "
            "are counted and shown, and not explained."
        )
    good = equally_good(rows)
    if len(good) > 1 and can_be_judged(rows):
        # Each setting has a row per aperture.
        labels = Counter(settings.depth_label for settings in good)
        order = dict.fromkeys(row.settings.depth_label for row in rows)
        named = ", ".join(f"{labels[label]} of {label}" for label in order if labels[label])
        notes["equally_good"] = (
            f"{len(good)} settings are equally good by error: {named}. "
            "xfrustum cost compares their times."
        )
    truths = counted(count, "certified truth")
    if measured.decided_by != alone.CERTIFIED:
        truths = f"{counted(count, 'picture')} by {measured.decided_by} alone"
    frames, seconds = counted(len(rows), "raster frame"), measured.times_s
    notes["cost"] = (
        f"Measured in {measured.wall_s:.2f} s of wall time, in which stages ran side by side: "
        f"{frames} with read-back {seconds['raster']:.2f} s, {truths} {seconds['trace']:.2f} s, "
        f"the page's pictures {seconds['pictures']:.2f} s."
    )
    return notes


def _missed_light(measured: Sweep) -> Iterator[str]:
    """Yield a sentence on the light that a rasterizer misses at each aperture."""
    film = math.prod(measured.scene.frustum.resolution)
    for part in measured.light.missed if measured.light else ():
        numbers = part.numbers
        yield (
            f"Aperture {part.aperture.column},{part.aperture.row}: light transport changes "
            f"{numbers.pixels:,} pixels ({percent(numbers.pixels / film)}), "
            f"{numbers.darker:,} of them to darker; rms {digits(numbers.rms)} in radiance, "
            f"after noise of {digits(numbers.rms_noise)} is taken off."
        )


# Page
# --------------------------------------------------------------------------------------------------


def render_page(measured: Sweep, content: dict[str, Any], notes: dict[str, str]) -> str:
    """Return the report as one HTML document that loads nothing else."""
    scene, names = measured.scene, geometry_names(measured.geometries)
    values = {
        "sweep": measured,
        "choosing": choosing,
        "notes": notes,
        "near_range": near_range,
        "fit": scene_fit(scene),
        "told": content["best"],
        "scouted_lines": FILM_PIXELS**2,
        "chosen": choices(measured.auto) if measured.auto else (),
        "settings_count": len({row.settings for row in measured.rows}),
        "certainty": {row.aperture: row.comparison.certainty for row in measured.rows},
        "certainty_labels": {kind.name.lower(): label for kind, label in CERTAINTY_LABELS.items()},
        "images": pictures,
        "height_range": pictures.height_range(scene, scene.frustum.longest_reach),
        "pixels_per_degree": PIXELS_PER_DEGREE,
        "name_of": lambda settings: names[geometry_of(settings)],
        "sheared": scene.frustum.recentered
        and any(each.pivot is Pivot.CAMERA for each in measured.geometries),
        "without_offset": any(each.offset is Offset.NONE for each in measured.geometries),
        "unexplained": sum(row.unexplained or 0 for row in measured.rows),
        "page_data": _page_data(measured, content["rows"]),
    }
    return html_page("report.html.j2", values, {"pixels": pixels, "sentence": SENTENCES.get})


def _page_data(measured: Sweep, numbers: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the data of the script; equal pictures of several settings are stored once."""
    stored: dict[str, str] = {}

    def keep(encoded: bytes) -> str:
        # 64 bits: a collision among some thousand pictures has a chance of 1e-13.
        key = hashlib.sha256(encoded).hexdigest()[:16]
        if key not in stored:
            stored[key] = address(encoded)
        return key

    scene, light, geometries = measured.scene, measured.light, measured.geometries
    reach, best, names = scene.frustum.longest_reach, measured.best, geometry_names(geometries)
    keys = [(row.settings, row.aperture) for row in measured.rows]
    eye = (
        [(error.near / reach, error.measured, error.predicted) for error in light.eye]
        if light
        else ()
    )
    return {
        "rows": [
            {
                **own,
                "geometry": geometries.index(geometry_of(row.settings)),
                "depth": row.settings.depth_label,
                "near": row.settings.near,
                "pictures": {name: keep(encoded) for name, encoded in row.pictures.items()},
            }
            for row, own in zip(measured.rows, numbers, strict=True)
        ],
        "cause_colors": pictures.CAUSE_COLORS,
        "geometries": list(names.values()),
        "apertures": [aperture.index for aperture in measured.apertures],
        "truths": [keep(truth.picture) for truth in measured.truths],
        "start": keys.index((best.settings, best.aperture)),
        "units": scene.units,
        "reach": reach,
        "pictures": stored,
        "curves": [
            [_curves(measured, aperture, geometry) for geometry in geometries]
            for aperture in measured.apertures
        ],
        "eye": pair_figure(eye, "rms change of radiance at the same surface points")
        if eye
        else None,
        "scout": map_figures(measured.auto) if measured.auto else (),
    }


def _curves(
    measured: Sweep, aperture: Aperture, geometry: DoubleFrustum
) -> dict[str, Figure | None]:
    """Return the figures of an aperture and a geometry by name; None if a figure has no points."""
    reach, rows = measured.scene.frustum.longest_reach, measured.numbered(aperture, geometry)
    quantities = FIGURES | (SHADED_FIGURES if measured.light else {})
    curves = {name: each.figure(by_depth(rows), reach) for name, each in quantities.items()}
    if len(measured.geometries) > 1:
        # A line for each geometry, with the depth buffer of the best setting.
        label = measured.best.settings.depth_label
        groups = {
            name: by_depth(measured.numbered(aperture, each)).get(label, ())
            for each, name in geometry_names(measured.geometries).items()
        }
        curves |= {name: each.figure(groups, reach) for name, each in GEOMETRY_FIGURES.items()}
    return curves | ({"causes": cause_figure(rows, reach)} if measured.options.causes else {})
