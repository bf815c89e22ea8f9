"""Instants that the periodic work of a node shares."""

import pytest

from swarmware.runtime.core import next_multiple_ns


@pytest.mark.parametrize(
    ("now", "phase", "expected"),
    [
        (0, 0, 100),
        (1, 0, 100),
        (99, 0, 100),
        (100, 0, 200),
        (-1, 0, 0),
        (-100, 0, 0),
        (29, 30, 30),
        (30, 30, 130),
        (131, 30, 230),
    ],
)
def test_next_instant_of_period_lies_after_now(now: int, phase: int, expected: int) -> None:
    assert next_multiple_ns(now, 100, phase) == expected
