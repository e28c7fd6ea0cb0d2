"""Table 1 and figure 7 of the paper, on scenes of this project.

`bench table1` measures table 1 on the project's own car, with as many triangles. `study figure7`
draws figure 7 as one page: C, C* as seen and as overlaid, and both cameras.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from tqdm import tqdm

from xfrustum.raster import Rasterizer
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.raster.rasterizer import SINGLE_SAMPLE
from xfrustum.reports.common.outputs import progress_bar, write_files
from xfrustum.reports.common.templates_environment import address, html_page, plain_text, png
from xfrustum.reports.common.timing import race
from xfrustum.reports.text import require_seen
from xfrustum.research.benchmarks import COLOR_ONLY, Record, exhaust, machine_record, settings_of
from xfrustum.scenes import (
    Aperture,
    Camera,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    HogelImage,
    InputError,
    Scene,
    shapes,
)
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.library import builtin
from xfrustum.scenes.library.objects import studio
from xfrustum.scenes.model.scene import read_only
from xfrustum.scenes.representation import LEVELS, encoded

#: Numbers of apertures around the middle of the plate: apertures drawn as a plate, and apertures
#: drawn one by one, with and without antialiasing. Drawing one by one takes longer.
COLUMNS, ANTIALIASED_COLUMNS = 12, 4

#: Measured antialiasing, with the largest number of coverage samples of Mesa's software renderer.
#: The paper does not state the number of its hardware.
ANTIALIASED = Sampling(multisample=4)

#: The machines of the paper; antialiasing was on in the first
REALITY_ENGINE, MAXIMUM_IMPACT = "RealityEngine2", "Maximum Impact"

#: Paper, table 1: number of polygons of a database, share of polygons with reflection mapping, and
#: the frames and polygons per second of each machine
PAPER = (
    (42_382, 0.312, {REALITY_ENGINE: (1.98, 84_077), MAXIMUM_IMPACT: (3.42, 144_868)}),
    (272_074, 0.479, {REALITY_ENGINE: (0.258, 70_286), MAXIMUM_IMPACT: (0.58, 159_710)}),
)


def benchmark_table1(
    resolution: int = 512, repeat: int = 5, databases: int = len(PAPER), *, progress: bool = False
) -> Record:
    """Measure the first databases of table 1 on the car, `repeat` times after a warm-up.

    Images have W = H pixels: the paper states no resolution. InputError without a usable
    OpenGL.
    """
    with progress_bar(3 * databases * (repeat + 1), "table 1", "run", shown=progress) as bar:
        rows = [_row(*row, resolution, repeat, bar) for row in PAPER[:databases]]
    return {
        "rows": [row for row, _ in rows],
        "resolution": (resolution, resolution),
        "antialiasing": False,
        "settings": settings_of(builtin.build("car")),
        "device": rows[0][1],
        **machine_record(),
    }


def _row(
    polygons: int,
    reflective: float,
    machines: Mapping[str, tuple[float, float]],
    resolution: int,
    repeat: int,
    bar: tqdm[Any],
) -> tuple[Record, str]:
    """Return a row of the table and the device; reflective triangles are submitted twice."""
    car = tessellated_car(polygons, reflective)
    scene = replace(
        mirrored(car), frustum=replace(car.scene.frustum, resolution=(resolution, resolution))
    )
    settings, (column, row) = settings_of(builtin.build("car")), scene.plate.middle.index
    apertures, few = (
        [scene.plate.aperture(column - count // 2 + place, row) for place in range(count)]
        for count in (COLUMNS, ANTIALIASED_COLUMNS)
    )
    with PlateRenderer(scene, settings, COLOR_ONLY) as renderer, Rasterizer(scene) as rasterizer:
        runs = {
            "plate": lambda: exhaust(renderer.hogels(apertures)),
            "one by one": lambda: exhaust(
                rasterizer.render_color(a, settings, SINGLE_SAMPLE) for a in few
            ),
            "antialiased": lambda: exhaust(
                rasterizer.render_color(a, settings, ANTIALIASED) for a in few
            ),
        }
        taken = race(runs, repeat, bar.update)
        submitted = renderer.drawn_triangles(apertures) / len(apertures)
        device = renderer.device["renderer"]
    # Times of a single frame.
    plate = taken["plate"].divided_by(len(apertures))
    plain, antialiased = (
        taken[name].divided_by(len(few)) for name in ("one by one", "antialiased")
    )

    def rates(frames: float, speed: float) -> Record:
        return {"frames_per_second": frames, "polygons_per_second": speed}

    def speed(seconds: float) -> Record:
        return rates(1 / seconds, polygons / seconds)

    row_record = {
        "polygons": polygons,
        "reflective_share": float(car.reflective.mean()),
        **speed(plate.median),
        "submitted_polygons_per_second": submitted / plate.median,
        "seconds_per_frame": plate,
        "paper": {
            name: {**rates(frames, speeds), "antialiasing": name == REALITY_ENGINE}
            for name, (frames, speeds) in machines.items()
        },
        "factors": {name: 1 / plate.median / frames for name, (frames, _) in machines.items()},
        "antialiased": {
            "samples": ANTIALIASED.multisample,
            **speed(antialiased.median),
            "seconds_per_frame": antialiased,
            "seconds_per_frame_without": plain,
            "slowdown": antialiased.median / plain.median,
            "factor": 1 / antialiased.median / machines[REALITY_ENGINE][0],
        },
    }
    return row_record, device


def table1_table(record: Record) -> str:
    """Return table 1 as text, one line for each machine."""
    machine, rows = record["machine"], record["rows"]
    lines = [
        f"{'polygons':>9}{'reflective':>12}{'frames/s':>11}{'polygons/s':>13}{'factor':>9}"
        "  drawn by"
    ]
    here = (
        f"{record['device']}, {machine['cores']} cores of {machine['processor']}, antialiasing off"
    )
    for row in rows:
        on = row["antialiased"]
        same = f"the same, hogel by hogel, antialiasing on ({on['samples']} samples)"
        drawn = [(row, "", here), (on, "", same)]
        for name, old in row["paper"].items():
            how = "on" if old["antialiasing"] else "off"
            drawn.append(
                (old, f"{row['factors'][name]:,.1f}", f"{name} (1996), antialiasing {how}")
            )
        begin = f"{row['polygons']:>9,}{100 * row['reflective_share']:>11.1f}%"
        for rates, factor, by in drawn:
            frames, polygons = rates["frames_per_second"], rates["polygons_per_second"]
            lines.append(f"{begin}{frames:>11.3g}{polygons:>13,.0f}{factor:>9}  {by}")
    values: Record = {"found": record, "table": "\n".join(lines), "machine": REALITY_ENGINE}
    values |= {"columns": COLUMNS, "few": ANTIALIASED_COLUMNS}
    return plain_text("table1.txt.j2", values).removesuffix("\n")


# The car with the numbers of triangles of table 1
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class TessellatedCar:
    """Built-in car with another number of triangles; the first triangles reflect."""

    scene: Scene
    #: (F,) mask of reflective triangles
    reflective: Mask


def tessellated_car(polygons: int, reflective_share: float) -> TessellatedCar:
    """Return the car with `polygons` triangles, or one fewer; a share of them is reflective.

    All triangles are split in four while their number stays within `polygons`; then the largest are
    split in three at their centroids. Raises InputError for fewer triangles than the built-in car
    has, or for a share outside 0 to 1.
    """
    scene = builtin.build("car")
    if polygons < len(scene.faces) or not 0 <= reflective_share <= 1:
        raise InputError(
            f"the car has at least {len(scene.faces):,} triangles, of which a share from 0 to 1 "
            f"may reflect; not {polygons:,} and {reflective_share}"
        )
    # Subdivide all triangles while the number permits, then split single triangles.
    while 4 * len(scene.faces) <= polygons:
        scene = shapes.refine(scene, 1)
    while (splits := (polygons - len(scene.faces)) // 2) > 0:
        a, b, c = np.moveaxis(scene.triangles, 1, 0)
        size = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        split = np.zeros(len(size), dtype=np.bool_)
        # Split the largest triangles; a stable sort makes the result the same on all machines.
        split[np.argsort(-size, kind="stable")[:splits]] = True
        ends = np.cumsum([len(part.faces) for part in scene.objects])[:-1]
        objects = []
        for part, chosen in zip(scene.objects, np.split(split, ends), strict=True):
            # Parts of a face remain neighbors in the drawing order.
            (a, b, c), numbers = part.faces[chosen].T, np.flatnonzero(chosen)
            middle, faces = len(part.vertices) + np.arange(len(numbers)), part.faces.copy()
            faces[chosen, 2] = middle
            others = np.stack([b, c, middle, c, a, middle], axis=1).reshape(-1, 3)
            faces = np.insert(faces, np.repeat(numbers + 1, 2), others, axis=0)
            centroids = part.vertices[part.faces[chosen]].mean(axis=1)
            vertices = np.concatenate([part.vertices, centroids])
            objects.append(replace(part, vertices=vertices, faces=faces))
        scene = replace(scene, objects=tuple(objects))
    reflective = np.arange(len(scene.faces)) < round(reflective_share * len(scene.faces))
    return TessellatedCar(scene=scene, reflective=read_only(reflective))


def mirrored(car: TessellatedCar) -> Scene:
    """Return the smoothed car in the studio's paint, reflecting on reflective triangles only."""
    studio_look = studio()
    paint = studio_look.materials["paint"]
    dull = replace(paint, reflectivity=(0.0, 0.0, 0.0))
    objects, first = [], 0
    for part in map(shapes.smoothed, car.scene.objects):
        reflective = car.reflective[first : first + len(part.faces)]
        first += len(part.faces)
        for material, chosen in (("paint", reflective), ("dull", ~reflective)):
            if chosen.any():
                objects.append(replace(part, faces=part.faces[chosen], material=material))
    materials = MappingProxyType({"paint": paint, "dull": dull})
    return replace(
        car.scene, objects=tuple(objects), appearance=replace(studio_look, materials=materials)
    )


#: Default near offset, share of the reach. Points farther than a percent of the reach from the
#: plate are displaced by less than 1e-4 W/2, 0.03 px at W = 512; and a reversed float depth buffer
#: resolves 2^-24 of any depth, however small near is.
NEAR_PER_REACH = 1e-6

LATTICE = (
    4  #: apertures along each side of the plate among which the second perspective of C* is chosen
)

_PAGE = "index.html"
_DRAWN = (Camera.C, Camera.C_STAR, Camera.BOTH)
#: Names of the pictures of C*: as the camera sees it, and from another aperture.
_AS_SEEN, _OTHER = "c-star-as-seen", "c-star-other"
#: Names of the written files; the other aperture's exists only where the plate has one.
FILES = (
    _PAGE,
    *(f"{name}.png" for name in (*(camera.value for camera in _DRAWN), _AS_SEEN, _OTHER)),
)


def default_settings(scene: Scene, near: float | None) -> DoubleFrustum:
    """Return settings with which neither near offset nor depth buffer has a visible effect."""
    near = NEAR_PER_REACH * scene.frustum.longest_reach if near is None else near
    return DoubleFrustum(near=near, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED)


def write_figure(
    scene: Scene, aperture: Aperture, settings: DoubleFrustum, other: Aperture | None, out: Path
) -> tuple[Path, ...]:
    """Draw C, C* and both at one aperture, and C* at another aperture; write the page.

    `other` is the aperture of the second perspective of C*. If it is None, an aperture of a coarse
    lattice over the plate is chosen: the other aperture at which C* shows most. InputError if
    near is not smaller than the reach, the aperture sees nothing of the objects, there is no usable
    OpenGL, or the folder cannot be written.
    """
    require_seen(scene, [aperture])
    times_s, images, alone = {}, {}, replace(settings, camera=Camera.C_STAR)
    columns, rows = (
        [round(place * (count - 1) / (LATTICE - 1)) for place in range(LATTICE)]
        for count in scene.plate.hogels
    )
    lattice = dict.fromkeys(
        scene.plate.aperture(column, row) for row, column in product(rows, columns)
    )
    with Rasterizer(scene) as rasterizer:
        # The first picture compiles the shaders.
        rasterizer.render(aperture, settings, normals=False)
        for camera in _DRAWN:
            begun = time.perf_counter()
            image = rasterizer.render(aperture, replace(settings, camera=camera), normals=False)
            images[camera.value], times_s[camera.value] = image, time.perf_counter() - begun

        def covered(candidate: Aperture) -> int:
            return int(
                rasterizer.render(candidate, alone, normals=False, color=False).covered.sum()
            )

        if other is None:
            other = max(
                (candidate for candidate in lattice if candidate != aperture),
                key=covered,
                default=None,
            )
        if other is not None:
            images[_OTHER] = rasterizer.render(other, alone, normals=False)
        device = rasterizer.device["renderer"]
    pictures = {name: picture(image, as_seen=name == _OTHER) for name, image in images.items()}
    pictures[_AS_SEEN] = picture(images[Camera.C_STAR.value], as_seen=True)
    values = {
        **{
            "scene": scene,
            "aperture": aperture,
            "other": other,
            "settings": settings,
            "device": device,
        },
        "times_s": times_s,
        "covered": {name: float(image.covered.mean()) for name, image in images.items()},
        "pictures": {name: address(encoded) for name, encoded in pictures.items()},
    }
    files = {f"{name}.png": content for name, content in pictures.items()}
    return write_files(out, {_PAGE: html_page("figure7.html.j2", values), **files})


def picture(image: HogelImage, *, as_seen: bool = False) -> bytes:
    """Encode the color image as PNG: clipped, sRGB, 8 bits; transparent where there is no surface.

    An image lies on the film. C* looks from the plate back at the viewer, with +y up and therefore
    +x to its left: its own view has the same left and right, but top and bottom are exchanged.
    """
    assert image.color is not None
    color = np.rint(LEVELS * encoded(image.color))
    pixels = np.dstack((color, np.where(image.covered, LEVELS, 0)))
    return png(np.flipud(pixels) if as_seen else pixels)
