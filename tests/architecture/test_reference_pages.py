"""The pages of the folder `reference`: complete against files and code, true where a table can be tried."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from swarmctl.main import INTERRUPTED
from swarmware.errors import KINDS
from swarmware.mission.catalogue import BLOCKS, BlockType
from swarmware.mission.manifest import read_manifest
from swarmware.model.names import Pattern

ROOT = Path(__file__).parents[2]
REFERENCE = ROOT / "share/doc/reference"
FILES = {
    str(path.relative_to(ROOT / "etc/swarm")): tomllib.loads(path.read_text())
    for path in (ROOT / "etc/swarm").rglob("*.toml")
}


def rows(text: str) -> list[list[str]]:
    """The cells of every table of a text, without its heads."""
    lines = re.findall(r"^\|(.*)\|$", text, re.MULTILINE)
    cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)] for line in lines]
    ruled = {number for number, row in enumerate(cells) if set(row) == {"---"}}
    return [row for number, row in enumerate(cells) if not {number, number + 1} & ruled]


def sections(page: str) -> dict[str, str]:
    parts = re.split(r"^## ", (REFERENCE / page).read_text("utf-8"), flags=re.MULTILINE)[1:]
    return {part.partition("\n")[0]: part for part in parts}


def keys(table: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from keys(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def test_every_configuration_file_has_its_section() -> None:
    assert set(sections("configuration.md")) == set(FILES)


@pytest.mark.parametrize("file", FILES)
def test_key_of_file_is_documented_with_default(file: str) -> None:
    found = rows(sections("configuration.md")[file])
    assert found
    assert [row for row in found if not (row[1] and row[5])] == [], "expected type and meaning"
    page = {row[0].strip("`"): row for row in found}
    shipped = dict(keys(FILES[file]))
    assert shipped.keys() <= page.keys()
    for key, value in shipped.items():
        if not (isinstance(value, list) and value and isinstance(value[0], dict)):
            assert page[key][3] == f"`{msgspec.json.encode(value).decode()}`", key


@pytest.mark.parametrize("page", ["settings.md", "templates.md", "documents.md", "exit-codes.md"])
def test_line_of_generated_table_has_description(page: str) -> None:
    generated = (REFERENCE / page).read_text("utf-8").partition("<!-- from the code")[2]
    found = rows(generated)
    assert found
    assert [row for row in found if not row[-1]] == []


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.name)
def test_parameter_of_block_is_documented_with_meaning(block: BlockType) -> None:
    text = (REFERENCE / "mission-files.md").read_text("utf-8")
    section = re.split(r"^#{2,3} ", text.partition(f"\n### {block.name}\n")[2], flags=re.MULTILINE)[0]
    assert block.purpose in section
    found = {row[0].strip("`"): row for row in rows(section) if len(row) == 7}
    assert set(found) == {field.encode_name for field in msgspec.structs.fields(block.params)}
    assert [row for row in found.values() if not (row[2] and row[6])] == []
    assert all(f"`{kind}`" in section for kind in block.errors)
    assert all(f"`{other}`" in found[name][1] for other, name in block.aliases)


def test_key_of_mission_file_is_documented_with_meaning() -> None:
    page = sections("mission-files.md")
    found = [row for row in rows(page["mission.toml"]) if not (row[1] and row[5])]
    assert found == []
    named = {row[0].strip("`") for row in rows(page["A role's file (BDL)"])}
    assert {"mission", "params", "requires", "on_failure", "next", "timeout_s", "on"} <= named


def test_examples_of_page_of_mission_files_are_valid() -> None:
    blocks = re.findall(
        r"^```toml\n(.*?)^```$", (REFERENCE / "mission-files.md").read_text("utf-8"), re.MULTILINE | re.DOTALL
    )
    manifests = [read_manifest(text, "page") for text in blocks if "[[roles]]" in text]
    assert [role.name for role in manifests[0].roles] == ["lead", "air"]


def test_the_table_of_patterns_is_what_patterns_do() -> None:
    table = rows((REFERENCE / "paths.md").read_text("utf-8").partition("## Patterns")[2])
    assert len(table) >= 4
    for row in table:
        (pattern,), yes, no = (re.findall(r"`([^`]+)`", cell) for cell in row[2:])
        assert [path for path in yes if not Pattern(pattern).matches(path)] == [], pattern
        assert [path for path in no if Pattern(pattern).matches(path)] == [], pattern
        assert yes
        assert no


def test_every_exit_code_is_on_the_page() -> None:
    head = (REFERENCE / "exit-codes.md").read_text("utf-8").partition("<!-- from the code")[0]
    codes = {int(row[0]) for row in rows(head)}
    assert codes == {0, 2, INTERRUPTED} | {cls.exit_code for cls in KINDS.values()}
