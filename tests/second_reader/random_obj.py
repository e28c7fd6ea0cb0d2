"""OBJ files of random layout, for the comparison of both readers without a closed form."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

OTHERS = [
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
    """Return a file of triangles and of polygons, convex and concave, in random layout."""
    random = np.random.default_rng(seed)
    statements: list[str] = []
    counts = {"v": 0, "vt": 0, "vn": 0}
    for _ in range(int(random.integers(1, 8))):
        statements.append(str(random.choice(OTHERS)))
        corners = outline(random)
        color = random.random() < 0.2
        for corner in corners.tolist():
            words = [number(random, value) for value in corner]
            words += [number(random, value) for value in random.random(3).tolist()] if color else []
            statements.append(" ".join(["v", *words]))
        counts["v"] += len(corners)
        for kind, width in (("vt", 2), ("vn", 3)):
            for _ in range(int(random.integers(0, 4))):
                values = random.normal(size=width).tolist()
                statements.append(" ".join([kind, *(number(random, value) for value in values)]))
                counts[kind] += 1
        first = counts["v"] - len(corners)
        statements.append(face(random, list(range(first, counts["v"])), counts))
        for _ in range(int(random.integers(0, 4))):
            chosen = random.choice(counts["v"], 3, replace=False).tolist()
            statements.append(face(random, chosen, counts))
    return written(random, statements)


def outline(random: Generator) -> np.ndarray:
    """Return a star-shaped polygon in a random plane, its corners exact."""
    count = int(random.integers(3, 10))
    angles = np.sort(random.random(count) + np.arange(count)) * (2 * np.pi / count)
    radius = random.uniform(0.3, 4, count)
    flat = np.round(np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1) * 64) / 64
    across, along = random.integers(-3, 4, (2, 3)).astype(np.float64)
    if not np.cross(across, along).any():
        across, along = np.array([1.0, 0, 2]), np.array([0.0, 1, 1])
    place = np.round(random.normal(size=3) * 10.0 ** random.integers(0, 6))
    return np.asarray(place + flat[:, :1] * across + flat[:, 1:] * along)


def face(random: Generator, places: list[int], counts: dict[str, int]) -> str:
    """Return a face with or without texture and normals, its indices absolute or relative."""
    kinds = ["v", *(kind for kind in ("vt", "vn") if counts[kind] and random.random() < 0.5)]
    words = []
    for place in places:
        parts = {"v": place} | {kind: int(random.integers(counts[kind])) for kind in kinds[1:]}
        texts = {
            k: str(n + 1 if random.random() < 0.5 else n - counts[k]) for k, n in parts.items()
        }
        words.append("/".join([texts["v"], texts.get("vt", ""), texts.get("vn", "")]).rstrip("/"))
    return " ".join(["f", *words])


def number(random: Generator, value: float) -> str:
    """Return a number in one of its forms, all digits kept."""
    text = repr(value)
    form = random.random()
    if form < 0.2 and value >= 0:
        return "+" + text
    if form < 0.4:
        return f"{value:.17e}" if form < 0.3 else f"{value:.17E}"
    return text.removesuffix("0") if form < 0.6 and text.endswith(".0") else text


def written(random: Generator, statements: list[str]) -> bytes:
    """Return statements as text: line ends, blanks, comments, continued lines, byte-order mark."""
    end = str(random.choice(["\n", "\r\n", "\r"]))
    style = random.random(5) < 0.4
    lines = []
    for statement in statements:
        line = statement
        if style[0]:
            line = line.replace(" ", str(random.choice(["\t", "  ", " \t"])))
        if style[1]:
            line = str(random.choice(["", " ", "\t"])) + line + str(random.choice(["", " ", "\t "]))
        if style[2] and random.random() < 0.3 and line.lstrip()[:1] == "f":
            words = line.split()
            middle = int(random.integers(1, len(words)))
            line = " ".join(words[:middle]) + " \\" + end + " ".join(words[middle:])
        elif style[3] and random.random() < 0.3:
            line += str(random.choice([" # note", "# f 1 2 3", " #"]))
        lines.append(line)
    text = end.join(lines) + ("" if random.random() < 0.2 else end)
    return (b"\xef\xbb\xbf" if style[4] else b"") + text.encode()
