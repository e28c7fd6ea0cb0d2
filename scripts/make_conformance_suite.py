"""Make a suite of conformance cases: its scenes, meshes, and the list of cases with the digests of truths.

A suite that was released is frozen, and never made again: this script shows where its cases came
from, and begins the next one. `python scripts/make_conformance_suite.py FOLDER` writes cases.toml,
scenes and meshes.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from tests.wrong_renderers import worlds

from xfrustum.compare.judging.conformance import digest, mean_radiance, trace
from xfrustum.reference import Reference
from xfrustum.scenes.conformance import suite
from xfrustum.scenes.library import hard_cases


def obj(
    folder: Path, name: str, vertices: Any, faces: Any, uv: Any = None, texture: str | None = None
) -> str:
    """Write a mesh, and return its name from a scene file."""
    lines = [f"mtllib {name}.mtl", "usemtl picture"] if texture else []
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices, dtype=float).tolist()]
    lines += (
        [] if uv is None else [f"vt {u!r} {v!r}" for u, v in np.asarray(uv, dtype=float).tolist()]
    )
    for face in np.asarray(faces).tolist():
        lines.append(
            "f " + " ".join(f"{v + 1}/{v + 1}" if uv is not None else f"{v + 1}" for v in face)
        )
    (folder / "meshes" / f"{name}.obj").write_text("\n".join(lines) + "\n")
    if texture:
        (folder / "meshes" / f"{name}.mtl").write_text(f"newmtl picture\nmap_Kd {texture}\n")
    return f"../meshes/{name}.obj"


# Letters of few large triangles: what is mirrored, turned or exchanged shows in most pixels.
F = [(0, 0, 2, 9), (2, 7, 6, 9), (2, 4, 5, 6)]
P = [(0, 0, 2, 9), (2, 7, 6, 9), (4, 4, 6, 7), (2, 4, 4, 5.5)]


def letter(
    strokes: list[tuple[float, ...]], left: float, bottom: float, size: float, z: float
) -> Any:
    """Return rectangles of a letter, each two triangles, slanted in depth."""
    vertices, faces = [], []
    for x0, y0, x1, y1 in strokes:
        first = len(vertices)
        for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1)):
            px, py = left + size * x / 9, bottom + size * y / 9
            vertices.append((px, py, z + 0.15 * px - 0.1 * py))
        faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    return vertices, faces


class Maker:
    """What is made: scenes by name, and cases in their order."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.scenes, self.cases = folder, set[str](), list[dict[str, Any]]()
        for name in ("scenes", "meshes"):
            (folder / name).mkdir(parents=True, exist_ok=True)

    def scene(self, name: str, objects: list[dict[str, Any]], **how: Any) -> str:
        """Write a scene file; keys of `how` are those of its tables."""
        size, hogels = how.get("size", (24.0, 18.0)), how.get("hogels", (3, 3))
        lines = [f'name = "{name}"', 'units = "mm"', "[plate]"]
        lines += [f"size = {list(map(float, size))}", f"hogels = {list(hogels)}", "[frustum]"]
        lines += [f"resolution = {list(how.get('resolution', (64, 64)))}"]
        if "screen" in how:
            z, x, y, w, h = map(float, how["screen"])
            lines += [f"screen = {{ height = {z}, center = [{x}, {y}], size = [{w}, {h}] }}"]
        else:
            lines += [f"fov_deg = {list(map(float, how.get('fov', (50.0, 50.0))))}"]
        lines += [f"reach = {list(map(float, how.get('reach', (60.0, 70.0))))}"]
        for direction, color in how.get("lights", ()):
            lines += ["[[light]]", f"direction = {list(direction)}", f"color = {list(color)}"]
        for number, part in enumerate(objects):
            lines.append("[[object]]")
            material = part.get("look")
            lines += [
                f"{key} = {json.dumps(value)}" for key, value in part.items() if key != "look"
            ]
            if material:
                lines += [f'material = "m{number}"', f"[material.m{number}]"]
                lines += [f"{key} = {json.dumps(value)}" for key, value in material.items()]
        if "aperture" in how:
            lines += ["[sampling]", f"aperture = {how['aperture']}"]
        (self.folder / "scenes" / f"{name}.toml").write_text("\n".join(lines) + "\n")
        return name

    def case(self, level: str, name: str, scene: str, why: str, **more: Any) -> None:
        """Add a case; it asks for the middle hogel's triangles unless told otherwise."""
        table = {"name": f"{level}-{name}", "level": level, "scene": scene, "why": why}
        more.setdefault("asked", "triangle-id")
        # L0 fails on conventions alone. Of the wrong renderers of tests/conformance/table.py, those
        # of later levels get at most 26 % of a case's shown pixels wrong (moved-x), and each wrong
        # convention gets at least 56 % of some case (farthest): the bound lies between, nearer to
        # the first. In L4 colors do not tell slivers narrower than a pixel, nor what lies beyond
        # the film's border.
        more.setdefault("wrong", {"L0": 0.3, "L4": 0.005}.get(level, 0.0))
        self.cases.append(table | {key: value for key, value in more.items() if value is not None})

    def write(self) -> None:
        """Write the list of cases, each with the digest of its truth."""
        suite.FOLDER = self.folder
        lines = []
        for table in self.cases:
            table.setdefault("hogels", None)
            given = dict(table, hogels=tuple(map(tuple, table["hogels"] or ((0, 0),))))
            case = suite.Case(**given)
            opened = case.open()
            if table["hogels"] is None:
                middle = opened.plate.middle
                table["hogels"] = [middle.index]
                case = replace(case, hogels=(middle.index,))
            reference = Reference(opened)
            truths = [trace(case, reference, aperture) for aperture in case.apertures(opened)]
            shown = sum(int((one.triangle >= 0).sum()) for one in truths)
            table["digest"] = digest(truths)
            radiance = mean_radiance(truths)
            if radiance is not None:
                table["radiance"] = round(radiance, 6)
            share = shown / sum(one.triangle.size for one in truths)
            sys.stdout.write(f"{table['name']} {share:.2f}\n")
            lines.append("[[case]]")
            lines += [
                f"{key} = {json.dumps(list(map(list, value)) if key == 'hogels' else value)}"
                for key, value in table.items()
            ]
            lines.append("")
        (self.folder / "cases.toml").write_text("\n".join(lines))


def world(maker: Maker, made: worlds.World, name: str, **how: Any) -> str:
    """Write a scene of the wrong renderers' worlds, whose meshes are shared by its variants."""
    parts = []
    for part in made.parts:
        file = obj(maker.folder, f"{made.name}-{part.name}", part.corners, part.faces)
        look = {"ambient": part.ambient, "diffuse": list(part.diffuse), "specular": part.specular}
        look["exponent"] = part.exponent
        parts.append({"mesh": file, "smooth": how.get("smooth", part.smooth), "look": look})
    usual: dict[str, Any] = {
        "size": made.size,
        "hogels": made.hogels,
        "resolution": made.resolution,
        "reach": made.reach,
        "lights": [(made.light, (1.0, 1.0, 1.0))],
    }
    usual |= {"screen": made.screen} if made.screen and "fov" not in how else {"fov": made.fov_deg}
    return maker.scene(name, parts, **(usual | how))


def conventions(maker: Maker) -> None:
    """L0: letters, of which every mistake of a convention moves most pixels."""
    behind = obj(maker.folder, "behind-f", *letter(F, -17.0, -17.0, 40.0, -40.0))
    before = obj(maker.folder, "before-p", *letter(P, -3.0, -15.0, 30.0, 35.0))
    back, front = {"mesh": behind}, {"mesh": before}
    all_six = [(i, j) for j in range(2) for i in range(3)]
    maker.scene("letters", [back, front], hogels=(3, 2))
    maker.scene("letter-behind", [back])
    maker.scene("letter-before", [front])
    add = maker.case
    add(
        "L0",
        "behind",
        "letter-behind",
        "A letter behind the plate: which way up, and is it mirrored?",
    )
    add(
        "L0",
        "before",
        "letter-before",
        "A letter before the plate, which C* draws: its picture is turned.",
    )
    add(
        "L0",
        "both-sides",
        "letters",
        "Both halves in one film: each looks where it should.",
        hogels=[(1, 0)],
    )
    add(
        "L0",
        "order",
        "letters",
        "All hogels of a plate: columns from the left, rows from the top.",
        hogels=all_six,
    )
    for name, resolution, fov in (
        ("wide", (96, 48), (60.0, 30.0)),
        ("tall", (48, 96), (30.0, 60.0)),
    ):
        maker.scene(f"letters-{name}", [back, front], resolution=resolution, fov=fov, hogels=(2, 2))
        add(
            "L0",
            f"film-{name}",
            f"letters-{name}",
            "Columns and rows of the film are not exchanged.",
            hogels=[(0, 0), (1, 1)],
        )
    maker.scene("letters-anisotropic", [back, front], resolution=(64, 64), fov=(64.0, 40.0))
    add(
        "L0",
        "two-angles",
        "letters-anisotropic",
        "Both angles of view are used, each along its own axis.",
    )
    for name, hogels in (("one-row", (4, 1)), ("one-column", (1, 4))):
        maker.scene(f"letters-{name}", [back, front], hogels=hogels)
        ends = [(0, 0), (hogels[0] - 1, hogels[1] - 1)]
        add(
            "L0",
            name,
            f"letters-{name}",
            "A plate that is a line of hogels: apertures at centers of cells.",
            hogels=ends,
        )
    maker.scene("letters-large-plate", [back, front], size=(60.0, 40.0), hogels=(5, 5))
    add(
        "L0",
        "corners",
        "letters-large-plate",
        "The corners of a plate see the scene from its four sides.",
        hogels=[(0, 0), (4, 0), (0, 4), (4, 4)],
    )
    # The square covers 43 % of what is shown, more than L0 excuses.
    square = {"shape": "square", "scale": 20.0, "translate": [2.0, -2.0, 30.0]}
    maker.scene("covered", [back, square])
    add("L0", "half-over-half", "covered", "What lies before the plate covers what lies behind it.")
    steps = [
        {"shape": "square", "scale": s, "translate": [x, y, z]}
        for s, x, y, z in (
            (26.0, -4.0, 3.0, 20.0),
            (24.0, 2.0, -4.0, 34.0),
            (18.0, -5.0, 0.0, 48.0),
        )
    ]
    maker.scene("steps-before", steps)
    add(
        "L0",
        "farthest-wins",
        "steps-before",
        "Before the plate the surface nearest to the viewer wins.",
    )
    below = [
        dict(one, translate=[-one["translate"][0], one["translate"][1], -one["translate"][2]])
        for one in steps
    ]
    maker.scene("steps-behind", below)
    add(
        "L0",
        "nearest-wins",
        "steps-behind",
        "Behind the plate the surface nearest to the plate wins.",
    )
    numbered = [{"shape": "sphere", "scale": 2.0, "translate": [900.0, 900.0, -30.0]}] * 30
    maker.scene("many-numbers", [*numbered, back, front])
    add(
        "L0",
        "numbers",
        "many-numbers",
        "Triangle numbers need 17 bits: 66,240 lie outside of all films.",
    )
    for suffix, asked in (("objects", "object-id"), ("colors", "rgb"), ("srgb", "srgb")):
        add(
            "L0",
            suffix,
            "letters",
            f"The same film as {asked}.",
            asked=asked,
            hogels=[(0, 0), (2, 1)],
        )
    maker.scene("nothing", [{"mesh": behind, "translate": [0.0, 0.0, -400.0]}])
    add("L0", "nothing", "nothing", "A film that shows nothing: the background is 0.", wrong=0.0)
    maker.scene(
        "reach",
        [
            {"shape": "square", "scale": 60.0, "translate": [4.0, 0.0, -50.0]},
            {"shape": "square", "scale": 60.0, "translate": [0.0, 9.0, -30.0]},
            {"shape": "square", "scale": 30.0, "translate": [6.0, -8.0, 30.0]},
            {"shape": "square", "scale": 40.0, "translate": [0.0, 4.0, 55.0]},
        ],
        reach=(40.0, 40.0),
    )
    add("L0", "reach", "reach", "Surfaces beyond the reach are not drawn, on either side.")
    turned = {"mesh": behind, "rotate_deg": [10.0, -20.0, 90.0], "translate": [3.0, 2.0, -30.0]}
    maker.scene("placed", [turned, dict(front, scale=1.3)])
    add("L0", "placed", "placed", "Objects that the scene file turns, moves and makes larger.")
    wound = [dict(back, flip_winding=True), dict(front, flip_winding=True)]
    maker.scene("wound", wound)
    add("L0", "winding", "wound", "Faces wound the other way are drawn: nothing is culled.")


SOLIDS = ("box", "sphere", "cylinder", "cone", "torus")


def surfaces(maker: Maker) -> None:
    """L1: pixels, one by one, on both sides of the plate."""
    add = maker.case
    world(maker, worlds.harbor(), "harbor")
    world(maker, worlds.attic(), "attic-centered", fov=(58.0, 58.0))
    corners = {"nw": (0, 0), "ne": (2, 0), "middle": (1, 0), "sw": (0, 1), "se": (2, 1)}
    for name, index in corners.items():
        add(
            "L1",
            f"harbor-{name}",
            "harbor",
            "968 triangles on both sides and through the plate.",
            hogels=[index],
        )
    add(
        "L1",
        "harbor-objects",
        "harbor",
        "The same by the numbers of objects.",
        asked="object-id",
        hogels=[(0, 1), (2, 0)],
    )
    add(
        "L1",
        "attic",
        "attic-centered",
        "752 triangles before nothing: outlines against the background.",
        hogels=[(0, 0), (1, 1), (2, 2)],
    )
    for solid in SOLIDS:
        turned = {"shape": solid, "scale": 26.0, "rotate_deg": [25.0, 35.0, 10.0]}
        maker.scene(f"{solid}-behind", [dict(turned, translate=[3.0, -2.0, -38.0])])
        maker.scene(f"{solid}-before", [dict(turned, translate=[-2.0, 3.0, 38.0])])
        add(
            "L1",
            f"{solid}-behind",
            f"{solid}-behind",
            "A closed body behind the plate: its near side.",
        )
        add(
            "L1",
            f"{solid}-before",
            f"{solid}-before",
            "A closed body before the plate: its far side.",
            hogels=[(0, 1), (1, 1)],
        )
    maker.scene(
        "through",
        [
            {
                "shape": "box",
                "scale": 22.0,
                "rotate_deg": [20.0, 30.0, 0.0],
                "translate": [14.0, 2.0, 0.0],
            },
            {
                "shape": "cone",
                "scale": 40.0,
                "rotate_deg": [80.0, 0.0, 15.0],
                "translate": [-13.0, -3.0, 2.0],
            },
        ],
    )
    add(
        "L1",
        "through-the-plate",
        "through",
        "Bodies that the plate cuts: one side of each in either half.",
        hogels=[(1, 1), (0, 2)],
    )
    for name in ("asymmetric", "large-triangles"):
        add("L1", name, name, "A built-in scene on both sides of the plate.", resolution=[96, 96])
    add(
        "L1",
        "car",
        "car",
        "41,896 triangles, most of them smaller than a pixel.",
        resolution=[96, 96],
    )
    add(
        "L1",
        "sheets",
        "sheets",
        "Parallel sheets from 1e-1 to 1e-6 of the reach apart.",
        resolution=[96, 96],
    )
    add(
        "L1",
        "odd-film",
        "harbor",
        "A film of odd width and height.",
        resolution=[71, 53],
        hogels=[(1, 1)],
    )


DEPTHS = (
    ("d16", "standard"),
    ("d16", "logarithmic"),
    ("d24", "standard"),
    ("d24", "gl"),
    ("d24", "linear"),
    ("d24", "logarithmic"),
    ("d32f", "standard"),
    ("d32f", "reversed"),
)


def paper(maker: Maker) -> None:
    """L2: the paper's two cameras, each depth buffer and several offsets."""
    for depth, mapping in DEPTHS:
        maker.case(
            "L2",
            f"harbor-{depth}-{mapping}",
            "harbor",
            "The paper's cameras with this depth buffer.",
            near=0.7,
            depth=depth,
            mapping=mapping,
            hogels=[(0, 0), (2, 1)],
        )
    for near in (7.0, 0.07, 0.007):
        for depth, mapping in (("d24", "standard"), ("d32f", "reversed")):
            maker.case(
                "L2",
                f"harbor-near-{near:g}-{depth}",
                "harbor",
                f"An offset of {near / 70:g} of the reach.",
                near=near,
                depth=depth,
                mapping=mapping,
                hogels=[(1, 1)],
            )
    for depth, mapping in (("d16", "standard"), ("d24", "standard"), ("d32f", "reversed")):
        maker.case(
            "L2",
            f"sheets-{depth}-{mapping}",
            "sheets",
            "Sheets that the depth buffer may not tell apart.",
            near=0.15,
            depth=depth,
            mapping=mapping,
            resolution=[96, 96],
        )
    maker.case(
        "L2",
        "asymmetric",
        "asymmetric",
        "A hundredth of the reach, seen as a bend.",
        near=1.5,
        depth="d24",
        mapping="standard",
        resolution=[96, 96],
    )
    maker.case(
        "L2",
        "through-the-plate",
        "through",
        "Bodies that both near planes cut.",
        near=0.7,
        depth="d24",
        mapping="standard",
    )


def sheared(maker: Maker) -> None:
    """L3: projection screens, before and behind the plate, off the center, with and without an offset."""
    add = maker.case
    made = worlds.attic()
    world(maker, made, "attic")
    corners = [(0, 0), (2, 0), (1, 1), (0, 2), (2, 2)]
    for number, index in enumerate(corners):
        add(
            "L3",
            f"attic-{number}",
            "attic",
            "A screen before the plate, off the center.",
            hogels=[index],
        )
    screens = {
        "behind": (-40.0, 2.0, -1.5, 46.0, 40.0),
        "far-aside": (30.0, 25.0, -20.0, 30.0, 30.0),
        "far-before": (60.0, -4.0, 3.0, 66.0, 60.0),
        "close": (8.0, 1.0, 2.0, 12.0, 10.0),
    }
    for name, screen in screens.items():
        world(maker, made, f"attic-{name}", screen=screen)
        add(
            "L3",
            f"screen-{name}",
            f"attic-{name}",
            "Another place of the projection screen.",
            hogels=[(0, 0), (2, 1)],
        )
    for near in (0.65, 6.5):
        add(
            "L3",
            f"attic-near-{near:g}",
            "attic",
            "Sheared cameras step back along the shear of the plate.",
            near=near,
            depth="d24",
            mapping="standard",
            hogels=[(0, 0), (2, 1)],
        )
        add(
            "L3",
            f"behind-near-{near:g}",
            "attic-behind",
            "The same with a screen behind the plate.",
            near=near,
            depth="d24",
            mapping="standard",
            hogels=[(0, 2)],
        )
    add(
        "L3",
        "asymmetric",
        "asymmetric-recentered",
        "A built-in scene on an off-center screen.",
        resolution=[96, 72],
        hogels=[(0, 0), (40, 30), (80, 60)],
    )
    add(
        "L3",
        "five-screens",
        "hard/sheared-five-screens",
        "The shear is ten times the half-extent.",
        hogels=[(2, 2), (0, 0), (4, 0)],
    )


def light(maker: Maker) -> None:
    """L4: shading on both sides, reflection, texture, band limiting."""
    add = maker.case
    rgb: dict[str, Any] = {"asked": "rgb"}
    add(
        "L4",
        "harbor",
        "harbor",
        "Phong with flat normals, on both sides.",
        hogels=[(0, 0), (2, 1)],
        **rgb,
    )
    world(maker, worlds.cove(), "cove", smooth=True)
    add("L4", "smooth", "cove", "Interpolated normals.", hogels=[(1, 0), (0, 1)], **rgb)
    add("L4", "smooth-srgb", "cove", "The same, stored as sRGB.", asked="srgb", hogels=[(1, 0)])
    add("L4", "attic", "attic", "Phong through sheared frusta.", hogels=[(0, 0), (2, 2)], **rgb)
    look = {"ambient": 0.05, "diffuse": [0.5, 0.3, 0.2], "specular": 0.4, "exponent": 20.0}
    for side, z in (("behind", -38.0), ("before", 38.0)):
        ball = {
            "shape": "sphere",
            "scale": 28.0,
            "translate": [2.0, -1.0, z],
            "smooth": True,
            "look": look,
        }
        white = (1.0, 1.0, 1.0)
        for name, lights in (
            ("lit-from-viewer", [((-0.4, 0.6, 0.8), white)]),
            ("lit-from-behind", [((0.5, 0.4, -0.7), white)]),
            (
                "two-lights",
                [((-0.7, 0.2, 0.5), (0.6, 0.3, 0.1)), ((0.8, -0.3, 0.4), (0.1, 0.3, 0.6))],
            ),
        ):
            maker.scene(f"{name}-{side}", [ball], lights=lights)
            add(
                "L4",
                f"{name}-{side}",
                f"{name}-{side}",
                "Lights at infinity are their own conjugates.",
                **rgb,
            )
        flipped = dict(ball, flip_winding=True)
        maker.scene(f"turned-over-{side}", [flipped], lights=[((-0.4, 0.6, 0.8), white)])
        add("L4", f"turned-over-{side}", f"turned-over-{side}", "Lighting is two-sided.", **rgb)
        Image.fromarray(picture()).save(maker.folder / "meshes" / "picture.png")
        x, y = np.meshgrid(np.linspace(-16, 16, 5), np.linspace(-14, 14, 5))
        sheet = np.stack([x, y, z + 0.3 * x], axis=-1).reshape(-1, 3)
        grid = np.arange(25).reshape(5, 5)
        quads = np.stack(
            [grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=-1
        ).reshape(-1, 4)
        faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        uv = np.stack([(x + 16) / 24, (y + 14) / 28], axis=-1).reshape(-1, 2)
        file = obj(maker.folder, f"sheet-{side}", sheet, faces, uv, "picture.png")
        textured = {"mesh": file, "look": {"ambient": 0.2, "diffuse": 0.8, "specular": 0.0}}
        maker.scene(f"texture-{side}", [textured], lights=[((-0.4, 0.6, 0.8), white)])
        add(
            "L4",
            f"texture-{side}",
            f"texture-{side}",
            "A texture: sRGB, bilinear, repeated, no mipmaps.",
            **rgb,
        )
    add(
        "L4",
        "reflection",
        "mirror-sphere",
        "Mirrors on both sides of the plate.",
        resolution=[64, 64],
        **rgb,
    )
    add(
        "L4",
        "studio",
        "car-studio",
        "Paint, glass, rubber and metal, lit and reflecting.",
        resolution=[96, 72],
        wrong=0.01,
        **rgb,
    )
    add(
        "L4",
        "band-limiting",
        "grating",
        "Bars finer than an aperture shows, over 16 sub-apertures.",
        resolution=[64, 64],
        wrong=0.02,
        **rgb,
    )


def plates(maker: Maker) -> None:
    """L5: hogels all over built-in plates of 4,941 apertures."""
    grid = [(0, 0), (40, 0), (80, 0), (0, 30), (40, 30), (80, 30), (0, 60), (40, 60), (80, 60)]
    for name, some in (
        ("asymmetric", grid),
        ("asymmetric-recentered", grid),
        ("crossing", grid[:4] + grid[5:]),
        ("large-triangles", grid[::2]),
        ("car", grid[::2]),
        ("car-recentered", grid[::4]),
        ("car-transfer", grid[::4]),
    ):
        maker.case(
            "L5",
            name,
            name,
            "A plate of 81 x 61 hogels: corners, edges and middle.",
            hogels=some,
            resolution=[48, 48]
            if "recentered" not in name and "transfer" not in name
            else [48, 36],
        )
    maker.case(
        "L5",
        "asymmetric-near",
        "asymmetric",
        "The plate by the paper's cameras.",
        hogels=grid[1::2],
        resolution=[48, 48],
        near=1.5,
        depth="d24",
        mapping="standard",
    )


def hard(maker: Maker) -> None:
    """L6: the hard cases, at the apertures that matter."""
    maker.case(
        "L6",
        "crossing",
        "crossing",
        "A wavy surface that passes through the aperture itself.",
        resolution=[48, 48],
    )
    for name in hard_cases.names(giants=False):
        one = hard_cases.CASES[name]
        if name != "hard/sheared-five-screens":
            maker.case(
                "L6",
                name.removeprefix("hard/"),
                name,
                f"{one.purpose}; {one.expected}.",
                hogels=[list(index) for index in one.apertures[:3]],
            )


def picture() -> Any:
    """Return a picture without symmetry, 24 x 16."""
    x, y = np.meshgrid(np.arange(24), np.arange(16))
    bars = 80 + 60 * ((x // 4 + y // 4) % 2)
    rgb = np.stack([bars + 4 * x, bars + 5 * y, 90 + 0 * x + 40 * (x > 12)], axis=-1)
    rgb[2:9, 3:5] = rgb[2:4, 3:9] = rgb[5:7, 3:7] = (250, 240, 20)
    return rgb.clip(0, 255).astype(np.uint8)


def main() -> None:
    """Make the suite in the folder that is named."""
    maker = Maker(Path(sys.argv[1]))
    for group in (conventions, surfaces, paper, sheared, light, plates, hard):
        group(maker)
    maker.write()
    sys.stdout.write(f"{len(maker.cases)} cases\n")


if __name__ == "__main__":
    main()
