"""Self-healing and the watchdog wake a process at instants that it shares with its other periodic work."""

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests.unit.runtime.virtual_loop import VirtualLoop, run

from swarmware.node.node import TEND_NS, TEND_PHASE_NS
from swarmware.node.publication import Publication
from swarmware.runtime.instant import until
from swarmware.service import runner
from swarmware.testing.tmpnode import tmp_node

SECOND = 1_000_000_000
MS = 1_000_000
START_NS = 7_123_456_789


class EndOfTest(Exception):
    pass


@pytest.fixture
def virtual_clock(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The monotonic clock of this process shows the time of the loop that `set` names."""
    loops: list[VirtualLoop] = []
    usual = time.monotonic_ns
    monkeypatch.setattr(
        time, "monotonic_ns", lambda: START_NS + loops[0].virtual.now_ns if loops else usual()
    )
    return loops


def test_shared_files_are_checked_between_two_heartbeats(
    tmp_path: Path, virtual_clock: list[VirtualLoop], monkeypatch: pytest.MonkeyPatch
) -> None:
    checked: list[int] = []

    async def main(loop: VirtualLoop) -> None:
        virtual_clock.append(loop)
        try:
            async with tmp_node(tmp_path) as node:
                monkeypatch.setattr(Publication, "tend", lambda _, **__: checked.append(node.clock.now_ns()))
                made = node.publication("nav/height", slots=4, slot_bytes=256)
                await until(node.clock, node.clock.now_ns() + 10 * SECOND)
                made.close()
        finally:
            virtual_clock.clear()

    run(main)
    assert len(set(checked)) == 10
    assert all((at_ns - TEND_PHASE_NS) % TEND_NS < 2 * MS for at_ns in checked)


def test_watchdog_is_reset_at_half_time_multiples(
    tmp_path: Path, virtual_clock: list[VirtualLoop], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner, "freeze_later", lambda _: None)  # of this process, which runs on
    pings: list[int] = []

    async def main(loop: VirtualLoop) -> None:
        virtual_clock.append(loop)
        try:
            async with tmp_node(tmp_path) as node:
                end_ns = node.clock.now_ns() + 31 * SECOND

                class Notifier:
                    watchdog_s = 5.0

                    def ready(self, text: str) -> None:
                        assert "sim" in text

                    def alive(self) -> None:
                        pings.append(node.clock.now_ns())
                        if node.clock.now_ns() > end_ns:
                            raise EndOfTest

                async def started() -> None:
                    return None

                host = SimpleNamespace(
                    node=node, names=["sim"], failed=[], started=started, on_supervised=lambda received: None
                )
                with pytest.raises(EndOfTest):
                    await runner._notify_ready(host, Notifier())  # type: ignore[arg-type]
        finally:
            virtual_clock.clear()

    run(main)
    assert len(pings) == 8, "at the start, and each five seconds until the 31st has passed"
    assert all(at_ns % (5 * SECOND) < 2 * MS for at_ns in pings[1:])
