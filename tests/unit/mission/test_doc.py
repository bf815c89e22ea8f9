"""share/doc/missions.md says what the code does: the table of blocks, the examples, the files named."""

import json
import re
from pathlib import Path
from typing import Any

import msgspec
import pytest
from file_schemas import mission_schema

from swarmware.mission.binding import Binding
from swarmware.mission.catalogue import BLOCKS, BlockType
from swarmware.mission.check import check_text
from swarmware.mission.condition_parser import parse
from swarmware.mission.file_keys import BLOCK_KEYS
from swarmware.mission.plausible import CEILING_M, DEPTH_M, NEAR_RATIO, REACH_M
from swarmware.mission.published import PUBLISHED, PublishedType

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "share/doc/missions.md").read_text()


def row(block: BlockType) -> str:
    """The block's line of the table."""
    params = []
    for field in msgspec.structs.fields(block.params):
        optional = field.required or field.default is msgspec.UNSET
        default = "" if optional else f" = {show(field.default)}"
        params.append(f"`{field.name}{default}`")
    timeout = f"{block.timeout_s:g} s" if block.timeout_s else "–"
    errors = ", ".join(block.errors) or "–"
    who = ", ".join(block.kinds) or "all"
    return f"| {block.name} | {block.purpose} | {' '.join(params) or '–'} | {timeout} | {errors} | {who} |"


def show(value: Any) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(show(item) for item in value) + "]"
    return msgspec.json.encode(value).decode()


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.name)
def test_table_of_blocks_is_that_of_catalogue(block: BlockType) -> None:
    assert row(block) in TEXT


@pytest.mark.parametrize("published", PUBLISHED.values(), ids=lambda one: one.name)
def test_table_of_published_types_is_that_of_code(published: PublishedType) -> None:
    keys = ", ".join(f"`{key}` → `{name}`" for key, name in published.keys) or "–"
    lost = ", ".join(f"`{key}`" for key in published.ignored) or published.instead or "–"
    assert f"| {published.name} | {published.block or '–'} | {keys} | {lost} |" in TEXT


@pytest.mark.parametrize("example", re.findall(r"```json\n(.*?)```", TEXT, re.DOTALL))
def test_every_example_mission_is_sound(example: str) -> None:
    assert check_text(example, "missions.md", Binding())[1] == []


@pytest.mark.parametrize("example", re.findall(r"^    if: (.*)$", TEXT, re.MULTILINE))
def test_every_example_condition_can_be_read(example: str) -> None:
    parse(example)


@pytest.mark.parametrize("path", re.findall(r"`(share/[\w/.]+|tests/[\w/.]+|etc/[\w/.]+)`", TEXT))
def test_every_file_named_exists(path: str) -> None:
    assert (ROOT / path).exists()


def test_limits_of_positions_are_those_of_code() -> None:
    limits = f"more than {REACH_M / 1000:g} km from the map's origin, more than {CEILING_M:g} m above it"
    assert f"{limits} or more than {DEPTH_M:g} m below it" in TEXT
    assert f"a warning from {NEAR_RATIO:.0%} of the limit on".replace("%", " %") in TEXT


def test_documented_keys_of_block_match_schema() -> None:
    definitions = json.loads(mission_schema())["$defs"]
    found = set()
    for block in BLOCKS:
        own = {field.encode_name for field in msgspec.structs.fields(block.params)}
        found |= set(definitions[block.name]["properties"]) - own - {other for other, _ in block.aliases}
    assert {key.name for key in BLOCK_KEYS} == found - {"next_timeout", "next_error"}
