"""Printed records, checked against the JSON schemas of the package."""

import json
from functools import cache
from typing import Any

import click
import jsonschema

from xfrustum.reports.common.outputs import json_ready, schema_text


@cache
def validator(name: str) -> Any:
    """Return the schema validator of a record."""
    return jsonschema.Draft202012Validator(json.loads(schema_text(name)))


def problems(name: str, record: object) -> list[str]:
    """Return the places where a record violates its schema, with reasons."""
    return [
        f"{name}{error.json_path[1:]}: {error.message[:200]}"
        for error in validator(name).iter_errors(json_ready(record))
    ]


def check_printed(record: object) -> None:
    """Check the record of the current command, named like `bench-truth` or `device-replay`."""
    context = click.get_current_context()
    name = "-".join(context.command_path.split()[1:])
    if name == "device":
        kinds = {"listed": "-list", "replay": "-replay"}
        name += "".join(kind for option, kind in kinds.items() if context.params.get(option))
    assert problems(name, record) == []
