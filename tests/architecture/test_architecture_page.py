"""The pages on architecture and terms name what is there: files, classes, layers, contracts."""

import re
from pathlib import Path

import pytest
from tests.architecture.sources import CONTRACTS, ROOT

DOCUMENTS = ROOT / "share/doc"
ROOTS = (ROOT, ROOT / "lib/swarmware", ROOT / "daemons/swarmd", ROOT / "cli")
"""A path of the pages is below one of these."""
ARCHITECTURE = (DOCUMENTS / "architecture.md").read_text("utf-8")
FILE = re.compile(r"(?<![\w/<.-])([a-z_][\w/]*\.(?:py|toml))\b")


def files(text: str) -> list[str]:
    return sorted(set(FILE.findall(text)) - {"node.toml"})


def places(name: str) -> list[Path]:
    return [root / name for root in ROOTS if (root / name).is_file()]


@pytest.mark.parametrize("name", files(ARCHITECTURE))
def test_a_file_of_the_architecture_is_there(name: str) -> None:
    assert places(name), f"{name}: below none of lib/swarmware, daemons/swarmd, cli; expected a file"


WAYS = ARCHITECTURE.partition("**Doors.**")[2].partition("## 8.")[0]
"""The doors and the four paths: in their figures each file has its functions that act."""
GOALS = {
    "4. The path of a value": (22, 33),
    "5. The path of a command": (20, 35),
    "6. The path of a mission": (25, 32),
    "7. The path of a log record": (12, 16),
}
"""Maximum number of files that a value passes, by path, and with the files behind the doors of the path: a
longer listing has a hop that can be removed, and a door that hides more of it is not shorter."""


def acts(line: str) -> list[tuple[str, str]]:
    """Each function that a line of a way names, with the file before it."""
    parts = FILE.split(line)
    return [
        (name, function)
        for name, text in zip(parts[1::2], parts[2::2], strict=True)
        for function in re.findall(r"\b(\w+)\(", text)
    ]


DOORS = [line for line in WAYS.partition("## 4.")[0].splitlines() if line.startswith("| `")]
"""Rows of the table of doors: the door, and what is behind it."""
STEPS = sorted(
    {
        step
        for line in ["".join(re.findall(r"```\n(.*?)```", WAYS, re.DOTALL)), *DOORS]
        for part in line.splitlines()
        for step in acts(part)
    }
)


@pytest.mark.parametrize("step", STEPS, ids="".join)
def test_function_of_way_is_in_its_file(step: tuple[str, str]) -> None:
    name, function = step
    assert any(re.search(rf"\bdef {function}\(", place.read_text("utf-8")) for place in places(name)), step


def test_every_step_of_a_way_names_a_function() -> None:
    for figure in re.findall(r"```\n(.*?)```", WAYS, re.DOTALL):
        for line in figure.splitlines():
            assert set(FILE.findall(line)) == {name for name, _ in acts(line)}, line


def figures(heading: str) -> list[str]:
    """The figures of a section of the page, in their order."""
    section = WAYS.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    return re.findall(r"```\n(.*?)```", section, re.DOTALL)


@pytest.mark.parametrize("heading", GOALS)
def test_way_has_plain_drawing_before_files(heading: str) -> None:
    drawing, listing, *_ = figures(heading)
    assert not FILE.findall(drawing)
    assert len(drawing.splitlines()) <= 12
    assert FILE.findall(listing)


def passed(heading: str) -> set[str]:
    """Files of a path, with the files behind its doors, and behind theirs."""
    behind = {
        step: acts(others)
        for door, _, others in (row[2:].partition(" | ") for row in DOORS)
        for step in acts(door)
    }
    found: set[tuple[str, str]] = set()
    work = [step for line in figures(heading)[1].splitlines() for step in acts(line)]
    while work:
        step = work.pop()
        if step not in found:
            found.add(step)
            work += behind.get(step, ())
    return {name for name, _ in found}


def test_way_passes_few_files_as_page_states() -> None:
    four = r"(\d+), (\d+), (\d+) and (\d+)"
    (text,) = re.findall(rf"pass {four} files, and {four}", WAYS)
    listed = [len(set(FILE.findall(figures(heading)[1]))) for heading in GOALS]
    behind = [len(passed(heading)) for heading in GOALS]
    assert list(map(int, text)) == [*listed, *behind]
    for heading, *counts in zip(GOALS, listed, behind, strict=True):
        assert all(count <= goal for count, goal in zip(counts, GOALS[heading], strict=True)), heading


def test_layers_of_page_are_those_of_contract() -> None:
    (shown,) = re.findall(r"```layers\n(.*?)\n```", ARCHITECTURE, re.DOTALL)
    (floors,) = (contract["layers"] for contract in CONTRACTS if contract["id"] == "floors")
    assert shown.splitlines() == floors


def test_contracts_of_page_are_those_of_build() -> None:
    shown = dict(re.findall(r"^\| `([\w-]+)` \| (.*?) \|$", ARCHITECTURE.split("## 3.")[0], re.MULTILINE))
    named = {contract["id"]: contract["name"] for contract in CONTRACTS}
    assert {name: shown.get(name) for name in named} == named


def test_every_daemon_is_in_the_picture() -> None:
    daemons = {path.parent.name for path in (ROOT / "daemons/swarmd").glob("*/service.py")}
    shown = set(re.findall(r"^\| `(\w+)` \| ", ARCHITECTURE.split("## 2.")[0], re.MULTILINE))
    assert shown == daemons


GLOSSARY = (DOCUMENTS / "glossary.md").read_text("utf-8")
TERMS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in GLOSSARY.splitlines()
    if line.startswith("| ") and not line.startswith("| term ")
]


def test_terms_are_ordered_and_unique() -> None:
    terms = [row[0] for row in TERMS]
    assert len(terms) >= 40
    assert terms == sorted(set(terms))


@pytest.mark.parametrize("row", TERMS, ids=[row[0] for row in TERMS])
def test_term_has_meaning_equivalent_and_name_in_file(row: list[str]) -> None:
    _, meaning, elsewhere, code = row
    assert meaning and elsewhere
    found = re.fullmatch(r"`([\w/]+\.py)` `(\w+)`", code)
    assert found, f"{code}: expected `path.py` `Name`"
    path, name = found.groups()
    assert any(re.search(rf"\b{name}\b", place.read_text("utf-8")) for place in places(path)), code
