"""The pages of requirements and hazards are complete, and the tests and commands that they cite exist."""

import re
from typing import NamedTuple

import click
import pytest
from tests.architecture.pages import accept
from tests.architecture.sources import ROOT

PAGE = ROOT / "share/doc/requirements.md"
COUNTS = {"S0": 92, "S1": 85, "S2": 56, "S3": 32, "S4": 43}

THEMES = ("node", "links", "missions", "record", "ground", "scale")
STATE = re.compile(rf"done|none|part: \S.{{5,}}|later: ({'|'.join(THEMES)})")
CITATION = re.compile(r"\b(S[0-4])\.(\d+)(?:(?:–| to )(?:S[0-4]\.)?(\d+))?")
FOLDERS = ("lib", "daemons", "cli", "etc", "share", "tests")


class Line(NamedTuple):
    """One capability as the page has it."""

    id: str
    capability: str
    state: str
    shown_by: str
    source: str
    """Of the heading above it."""


def lines() -> list[Line]:
    found, source = [], ""
    for text in PAGE.read_text().splitlines():
        if heading := re.match(r"## (S\d) ", text):
            source = heading[1]
        if re.match(r"\| *S\d\.", text):
            cells = [cell.strip() for cell in text.strip().strip("|").split(" | ")]
            assert len(cells) == 4, f"expected four cells: {text}"
            found.append(Line(cells[0], cells[1], cells[2], cells[3], source))
    return found


LINES = lines()


def names_of(source: str) -> list[str]:
    return [f"{source}.{number}" for number in range(1, COUNTS[source] + 1)]


def faults_of(line: Line) -> list[str]:
    """What is wrong with the last cell of a line."""
    if line.state != "done" and not line.state.startswith("part"):
        return [] if line.shown_by == "–" else ["nothing is there, so nothing can show it: expected –"]
    return faults_in(line.shown_by)


def faults_in(shown_by: str) -> list[str]:
    """Errors in a cell that cites tests and commands."""
    shown = re.findall(r"`([^`]+)`", shown_by)
    if not shown or re.sub(r"`[^`]+`|,", "", shown_by).strip():
        return ["expected tests and commands in backticks, nothing else"]
    faults = []
    for each in shown:
        try:
            accept(each)
        except click.ClickException as error:
            faults.append(f"{each}: {error.format_message()}")
    return faults


def test_page_has_each_capability_once_in_order() -> None:
    assert len(LINES) == sum(COUNTS.values())
    assert f"the {len(LINES)} capabilities" in PAGE.read_text()
    for source in COUNTS:
        assert [line.id for line in LINES if line.source == source] == names_of(source)


def test_a_capability_has_a_sentence_and_a_state() -> None:
    assert not [line for line in LINES if not re.fullmatch(r"[A-Z0-9]\S*( \S+){3,}\.", line.capability)]
    assert not [f"{line.id}: {line.state}" for line in LINES if not STATE.fullmatch(line.state)]


def test_present_capability_is_shown_by_existing_tests() -> None:
    faults = [f"{line.id}: {fault}" for line in LINES for fault in faults_of(line)]
    assert not faults


def test_what_the_repository_cites_stands_on_the_page() -> None:
    known = {line.id for line in LINES}
    missing = []
    for path in (path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*"))):
        if path == PAGE or not path.is_file() or "__pycache__" in path.parts:
            continue
        try:
            text = path.read_text()
        except UnicodeDecodeError:  # a picture or a recording
            continue
        for source, first, last in CITATION.findall(text):
            cited = (f"{source}.{number}" for number in range(int(first), int(last or first) + 1))
            missing += [f"{path.relative_to(ROOT)}: {name}" for name in cited if name not in known]
    assert not missing


HAZARDS = ROOT / "share/doc/hazards.md"
HAZARD_ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for line in HAZARDS.read_text().splitlines()
    if line.startswith("| ") and not line.startswith("| hazard")
]


@pytest.mark.parametrize("row", HAZARD_ROWS, ids=lambda row: row[0])
def test_hazard_has_level_cause_detection_reaction_and_tests(row: list[str]) -> None:
    hazard, level, *words, shown_by = row
    assert len(words) == 3
    assert all(words)
    assert hazard.endswith(".")
    assert level in {"A", "B", "C"}
    assert faults_in(shown_by) == []
    assert all("::" in cited for cited in shown_by.split(", ")), "expected tests alone"


def test_communication_time_and_flight_loop_have_highest_level() -> None:
    assert len(HAZARD_ROWS) > 20
    highest = " ".join(" ".join(row) for row in HAZARD_ROWS if row[1] == "A")
    for word in ("beacon", "clock", "datagram", "flight/loop", "link_loss"):
        assert word in highest
