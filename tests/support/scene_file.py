"""Scene files of tests: a plate, its frustum and its objects as text, numbers in the test."""

import json

Numbers = tuple[float, ...]


def film(
    plate: Numbers,
    hogels: tuple[int, int],
    resolution: tuple[int, int],
    fov_deg: Numbers,
    reach: Numbers,
) -> str:
    """Return the tables of a plate and of its centered frustum; objects follow."""
    return (
        f"[plate]\nsize = {list(plate)}\nhogels = {list(hogels)}\n"
        f"[frustum]\nresolution = {list(resolution)}\nfov_deg = {list(fov_deg)}\n"
        f"reach = {list(reach)}\n"
    )


def named(name: str, units: str | None = None) -> str:
    """Return the keys of a file that stand before all tables."""
    return f"name = {json.dumps(name)}\n" + (f"units = {json.dumps(units)}\n" if units else "")


def part(shape: str, scale: float, translate: Numbers, **keys: object) -> str:
    """Return the table of an object that is one of the built-in shapes."""
    values = {"shape": shape, "scale": scale, "translate": translate, **keys}
    lines = [f"{key} = {json.dumps(value)}\n" for key, value in values.items()]
    return "".join(["[[object]]\n", *lines])
