"""The pages on architecture and terms name what is there: files, classes, layers, contracts."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCUMENTS = ROOT / "share/doc"
ROOTS = (ROOT, ROOT / "lib/swarmware", ROOT / "daemons/swarmd", ROOT / "cli")
"""A path of the pages is below one of these."""
ARCHITECTURE = (DOCUMENTS / "architecture.md").read_text("utf-8")
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
FILE = re.compile(r"(?<![\w/<.-])([a-z_][\w/]*\.(?:py|toml))\b")


def files(text: str) -> list[str]:
    return sorted(set(FILE.findall(text)) - {"node.toml"})


def places(name: str) -> list[Path]:
    return [root / name for root in ROOTS if (root / name).is_file()]


@pytest.mark.parametrize("name", files(ARCHITECTURE))
def test_a_file_of_the_architecture_is_there(name: str) -> None:
    assert places(name), f"{name}: below none of lib/swarmware, daemons/swarmd, cli; expected a file"


WAYS = ARCHITECTURE.partition("## 4.")[2].partition("## 8.")[0]
"""The four paths: in their figures each file has its functions that act."""


def acts(line: str) -> list[tuple[str, str]]:
    """Each function that a line of a way names, with the file before it."""
    parts = FILE.split(line)
    return [
        (name, function)
        for name, text in zip(parts[1::2], parts[2::2], strict=True)
        for function in re.findall(r"\b(\w+)\(", text)
    ]


STEPS = sorted(
    {
        step
        for line in "".join(re.findall(r"```\n(.*?)```", WAYS, re.DOTALL)).splitlines()
        for step in acts(line)
    }
)


@pytest.mark.parametrize("step", STEPS, ids="".join)
def test_a_function_of_a_way_is_in_its_file(step: tuple[str, str]) -> None:
    name, function = step
    assert any(re.search(rf"\bdef {function}\(", place.read_text("utf-8")) for place in places(name)), step


def test_every_step_of_a_way_names_a_function() -> None:
    for figure in re.findall(r"```\n(.*?)```", WAYS, re.DOTALL):
        for line in figure.splitlines():
            assert set(FILE.findall(line)) == {name for name, _ in acts(line)}, line


def test_the_layers_of_the_page_are_those_of_the_contract() -> None:
    (shown,) = re.findall(r"```layers\n(.*?)\n```", ARCHITECTURE, re.DOTALL)
    (floors,) = (contract["layers"] for contract in CONTRACTS if contract["id"] == "floors")
    assert shown.splitlines() == floors


def test_the_contracts_of_the_page_are_those_of_the_build() -> None:
    shown = dict(re.findall(r"^\| `([\w-]+)` \| (.*?) \|$", ARCHITECTURE.split("## 3.")[0], re.MULTILINE))
    named = {contract["id"]: contract["name"] for contract in CONTRACTS}
    assert {name: shown.get(name) for name in named} == named


def test_every_daemon_is_in_the_picture() -> None:
    daemons = {path.parent.name for path in (ROOT / "daemons/swarmd").glob("*/service.py")}
    shown = set(re.findall(r"^\| `(\w+)` \| ", ARCHITECTURE.split("## 2.")[0], re.MULTILINE))
    assert shown == daemons


def test_the_architecture_fits_one_reading() -> None:
    assert len(ARCHITECTURE.splitlines()) < 400


GLOSSARY = (DOCUMENTS / "glossary.md").read_text("utf-8")
TERMS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in GLOSSARY.splitlines()
    if line.startswith("| ") and not line.startswith("| term ")
]


def test_the_terms_are_in_order_and_each_is_there_once() -> None:
    terms = [row[0] for row in TERMS]
    assert len(terms) >= 40
    assert terms == sorted(set(terms))


@pytest.mark.parametrize("row", TERMS, ids=[row[0] for row in TERMS])
def test_a_term_has_a_meaning_an_equivalent_and_a_name_in_a_file(row: list[str]) -> None:
    _, meaning, elsewhere, code = row
    assert meaning and elsewhere
    found = re.fullmatch(r"`([\w/]+\.py)` `(\w+)`", code)
    assert found, f"{code}: expected `path.py` `Name`"
    path, name = found.groups()
    assert any(re.search(rf"\b{name}\b", place.read_text("utf-8")) for place in places(path)), code
