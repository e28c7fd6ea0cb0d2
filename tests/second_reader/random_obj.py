"""OBJ files of random layout, for a comparison of both readers without closed forms."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from tests.second_reader.model import Floats

_OTHERS = [
    "o part",
    "g a b",
    "usemtl red",
    "usemtl blue",
    "s off",
    "s 1",
    "# v 1 2 3",
    "",
    "mtllib none.mtl",
]


def random_obj(seed: int) -> bytes:
    """Return a file of triangles and polygons, convex and concave, in random layout."""
    random = np.random.default_rng(seed)
    statements: list[str] = []
    counts = {"v": 0, "vt": 0, "vn": 0}

    def add(kind: str, values: list[float]) -> None:
        statements.append(" ".join([kind, *(_number(random, value) for value in values)]))
        counts[kind] += 1

    for _ in range(int(random.integers(1, 8))):
        statements.append(str(random.choice(_OTHERS)))
        corners, first = _outline(random), counts["v"]
        color = random.random(3 * int(random.random() < 0.2)).tolist()
        for corner in corners.tolist():
            add("v", corner + color)
        for kind, width in (("vt", 2), ("vn", 3)):
            for _ in range(int(random.integers(0, 4))):
                add(kind, random.normal(size=width).tolist())
        statements.append(_face(random, list(range(first, counts["v"])), counts))
        for _ in range(int(random.integers(0, 4))):
            chosen = random.choice(counts["v"], 3, replace=False).tolist()
            statements.append(_face(random, chosen, counts))
    return _written(random, statements)


def _outline(random: Generator) -> Floats:
    """Return a star-shaped polygon in a random plane, with exact corners."""
    count = int(random.integers(3, 10))
    angles = np.sort(random.random(count) + np.arange(count)) * (2 * np.pi / count)
    radius = random.uniform(0.3, 4, count)
    flat = np.round(np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1) * 64) / 64
    across, along = random.integers(-3, 4, (2, 3)).astype(np.float64)
    if not np.cross(across, along).any():
        across, along = np.array([1.0, 0, 2]), np.array([0.0, 1, 1])
    place = np.round(random.normal(size=3) * 10.0 ** random.integers(0, 6))
    return np.asarray(place + flat[:, :1] * across + flat[:, 1:] * along)


def _face(random: Generator, places: list[int], counts: dict[str, int]) -> str:
    """Return a face with or without texture and normals, with absolute or relative indices."""
    kinds = {kind: bool(n and random.random() < 0.5) for kind, n in counts.items()}
    words = []
    for place in places:
        parts = []
        for kind, count in counts.items():
            index = place if kind == "v" else int(random.integers(max(count, 1)))
            text = str(index + 1 if random.random() < 0.5 else index - count)
            parts.append(text if kind == "v" or kinds[kind] else "")
        words.append("/".join(parts).rstrip("/"))
    return " ".join(["f", *words])


def _number(random: Generator, value: float) -> str:
    """Return a number in a random notation, with all digits."""
    text = repr(value)
    forms = [text, "+" + text if value >= 0 else text, f"{value:.17e}", f"{value:.17E}"]
    forms.append(text.removesuffix("0") if text.endswith(".0") else text)
    return str(random.choice(forms))


def _written(random: Generator, statements: list[str]) -> bytes:
    """Format statements with random line ends, blanks, comments, line continuations and BOM."""
    end = str(random.choice(["\n", "\r\n", "\r"]))
    blanks, indents, continued, comments, mark = random.random(5) < 0.4
    lines = []
    for line in statements:
        if blanks:
            line = line.replace(" ", str(random.choice(["\t", "  ", " \t"])))  # noqa: PLW2901
        words = line.split()
        if continued and words[:1] == ["f"]:
            middle = int(random.integers(1, len(words)))
            line = f"{' '.join(words[:middle])} \\{end}{' '.join(words[middle:])}"  # noqa: PLW2901
        elif comments:
            line += str(random.choice(["", " # note", "# f 1 2 3", " #"]))  # noqa: PLW2901
        lines.append(("\t " if indents else "") + line)
    text = end.join(lines) + ("" if random.random() < 0.2 else end)
    return (b"\xef\xbb\xbf" if mark else b"") + text.encode()
