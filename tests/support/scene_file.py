"""Scene files for tests, as text: a plate, its frustum and its objects."""

import json

Numbers = tuple[float, ...]


def film(
    plate: Numbers,
    hogels: tuple[int, int],
    resolution: tuple[int, int],
    fov_deg: Numbers,
    reach: Numbers,
) -> str:
    """Return the tables of a plate and its centered frustum; objects follow."""
    return (
        f"[plate]\nsize = {list(plate)}\nhogels = {list(hogels)}\n"
        f"[frustum]\nresolution = {list(resolution)}\nfov_deg = {list(fov_deg)}\n"
        f"reach = {list(reach)}\n"
    )


def named(name: str, units: str | None = None) -> str:
    """Return the keys that precede all tables in a file."""
    return f"name = {json.dumps(name)}\n" + (f"units = {json.dumps(units)}\n" if units else "")


def part(shape: str, scale: float, translate: Numbers, **keys: object) -> str:
    """Return the table of an object with a built-in shape."""
    values = {"shape": shape, "scale": scale, "translate": translate, **keys}
    lines = [f"{key} = {json.dumps(value)}\n" for key, value in values.items()]
    return "".join(["[[object]]\n", *lines])
