"""Reasons that the operator gets for fewer values than the owner writes."""

from typing import Any

import pytest
from tests.unit.cli.session import ScriptedSession

from swarmctl.resources import limits
from swarmctl.resources.rate_meter import RateMeter
from swarmware.model.resource import Kind
from swarmware.types.tree import TreeEntry


async def told(monkeypatch: pytest.MonkeyPatch, kind: Kind, link: str) -> str:
    async def no_limit(_session: Any, _path: str) -> None:
        return None

    monkeypatch.setattr(limits, "limit_of", no_limit)
    entry = TreeEntry(path="/uav1/map/delta", kind=kind, type="Text", link=link)
    return await limits.thinning(ScriptedSession({}), entry, RateMeter(5.0, numbered=True))


async def test_overloaded_stream_names_counter_of_losses(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text = await told(monkeypatch, Kind.STREAM, "request")
    assert "/uav1/tree/losses counts those that were lost" in text
    assert "request" not in text


async def test_board_names_way_that_carries_its_newest_value(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "the beacon carries the newest value only" in await told(monkeypatch, Kind.BOARD, "tick")
