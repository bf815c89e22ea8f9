"""The page of hazards: each row is complete, and the tests that it cites exist."""

import re
from pathlib import Path

import click
import pytest
from tests.architecture.pages import accept

PAGE = Path(__file__).parents[2] / "share/doc/hazards.md"
ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for line in PAGE.read_text().splitlines()
    if line.startswith("| ") and not line.startswith("| hazard")
]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_hazard_has_level_cause_detection_reaction_and_tests(row: list[str]) -> None:
    hazard, level, *words, shown_by = row
    assert len(words) == 3
    assert all(words)
    assert hazard.endswith(".")
    assert level in {"A", "B", "C"}
    cited = re.findall(r"`([^`]+)`", shown_by)
    assert cited
    assert not re.sub(r"`[^`]+`|,", "", shown_by).strip()
    for test in cited:
        assert "::" in test
        try:
            accept(test)
        except click.ClickException as error:
            pytest.fail(f"{test}: {error.format_message()}")


def test_communication_time_and_flight_loop_have_highest_level() -> None:
    assert len(ROWS) > 20
    highest = " ".join(" ".join(row) for row in ROWS if row[1] == "A")
    for word in ("beacon", "clock", "datagram", "flight/loop", "link_loss"):
        assert word in highest
