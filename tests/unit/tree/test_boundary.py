"""The boundary around one item: what fails in it is counted and logged, and does not end the tree."""

import asyncio

import pytest

from swarmd.tree.exchange.boundary import Boundary
from swarmware.errors import WireError


def test_boundary_failure_is_counted_and_reported_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    boundary = Boundary()
    for _ in range(3):
        for what, error in (
            ("value of nav/pose", ZeroDivisionError()),
            ("notification of uav3", WireError("too short")),
        ):
            with boundary(what):
                raise error
    assert boundary.refused == 6
    assert boundary.counts == {"value of nav/pose": 3, "notification of uav3": 3}
    told = [record.getMessage() for record in caplog.records]
    assert told == [
        "value of nav/pose: failed, left out: ZeroDivisionError()",
        "notification of uav3: refused: too short",
    ]


def test_an_end_passes_the_boundary() -> None:
    with pytest.raises(asyncio.CancelledError), Boundary()("anything"):
        raise asyncio.CancelledError
