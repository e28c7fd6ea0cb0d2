"""JSON schemas of records: valid, closed, and with the keys of the contract."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import jsonschema
import pytest

from tests.support.commands import Command
from tests.support.records import problems
from tests.support.worlds import World
from xfrustum import compare_images
from xfrustum.cli.app import cli
from xfrustum.reports.common.outputs import schema_names, schema_text

CONTRACT = {
    "compare": "pixels judged covered at_plate surface triangle displacement_px height radiance",
    "budget": "links",
    "survey": "hogels judged beyond share_beyond_at_most confidence tolerance_px worst workers "
    "wall_s settings truth_by",
    "view": "eyes",
    "plan": "near near_range depth mapping slabs sentence binds split limits plate command",
    "check": "effects unread",
    "verify": "verdict diagnosis where truth_by",
    "device": "renderer version software subpixel_bits snaps_depth depth filter_bits varyings "
    "tried",
    "conformance-list": "suite cases",
}
"""Keys that each record always has, by name of the record."""


def objects(schema: Any) -> list[dict[str, Any]]:
    """Return the schemas of all objects with properties inside a schema."""
    if isinstance(schema, list):
        return [item for part in schema for item in objects(part)]
    if not isinstance(schema, dict):
        return []
    own = [schema] if "properties" in schema and "additionalProperties" in schema else []
    return own + [item for part in schema.values() for item in objects(part)]


def json_commands(command: click.Command, name: str = "") -> Iterator[str]:
    """Yield the names of all commands with --json, in the form that schemas use."""
    if isinstance(command, click.Group):
        context = click.Context(command)
        for part in command.list_commands(context):
            inner = command.get_command(context, part)
            assert inner is not None
            yield from json_commands(inner, f"{name}-{part}".removeprefix("-"))
    elif any("--json" in option.opts for option in command.params):
        yield name


def test_every_json_object_that_a_command_prints_has_a_schema() -> None:
    assert set(json_commands(cli)) <= set(schema_names())


def test_records_of_checks_and_benchmarks_keep_their_schemas(tiny: World, command: Command) -> None:
    for line in (
        f"bench plate {tiny.scene_file} --resolution 8 --repeat 1",
        "selfcheck hard/closed-edges --quick",
    ):
        assert command(f"{line} --json --quiet").record


def test_written_records_keep_their_schemas(tiny: World, tmp_path: Path, command: Command) -> None:
    def written(line: str, file: str) -> Any:
        command(f"{line} --out {tmp_path}")
        return json.loads((tmp_path / file).read_text())

    scene, near = tiny.scene_file, "--near 1"
    cameras = written(f"camera {scene} --for json --cull back --slabs 20 {near}", "cameras.json")
    assert problems("cameras", cameras) == []
    drawn = f"{near} --depth d24 --no-causes --quiet"
    assert problems("report", written(f"report {scene} {drawn}", "report.json")) == []
    case = written("conformance show L3-attic-0", "case/case.json")
    assert problems("conformance-case", case) == []


@pytest.mark.parametrize("name", schema_names())
def test_a_schema_is_valid_and_lists_all_keys(name: str) -> None:
    schema = json.loads(schema_text(name))
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["title"] and objects(schema)
    assert all(part["additionalProperties"] is False for part in objects(schema))


@pytest.mark.parametrize("name", CONTRACT)
def test_the_keys_of_the_contract_are_required(name: str) -> None:
    assert set(CONTRACT[name].split()) <= set(json.loads(schema_text(name))["required"])


def test_a_missing_key_an_unknown_key_and_another_type_are_problems(tiny: World) -> None:
    record = compare_images(tiny.truth(), tiny.raster(), tiny.reference).summary()
    assert problems("compare", record) == []
    assert problems("compare", {k: v for k, v in record.items() if k != "judged"})
    assert problems("compare", record | {"extra": 1})
    assert problems("compare", record | {"pixels": "many"})


def test_the_command_prints_schemas_and_their_names(command: Command) -> None:
    assert command("schema").out.split() == schema_names()
    assert command("schema compare").record["title"]
