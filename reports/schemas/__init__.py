"""JSON schemas of the records that commands print and write: one file for each record."""

from importlib.resources import files

from xfrustum.scenes.arguments import InputError


def schema_names() -> list[str]:
    """Return the names of all records, sorted."""
    return sorted(
        path.name.removesuffix(".json")
        for path in files(__name__).iterdir()
        if path.name.endswith(".json")
    )


def schema_text(name: str) -> str:
    """Return the JSON schema of a record as text.

    Raises
    ------
    InputError
        If there is no record of the name.
    """
    if name not in schema_names():
        raise InputError(f"schema {name}: no such record; name one of {', '.join(schema_names())}")
    return (files(__name__) / f"{name}.json").read_text(encoding="utf-8")
