"""A short condition, such as removed files, is reported long enough to be seen."""

import asyncio
from typing import Any, cast

import pytest
from tests.unit.runtime.virtual_loop import VirtualLoop, run

from swarmware.health.held_condition import HOLD_S, HeldCondition
from swarmware.health.monitor import HealthMonitor
from swarmware.node.run_files import Damage
from swarmware.service.host import DamageReport


class Reported:
    """The reports of a module, instead of its monitor."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str, str]] = []

    def report(self, name: str, state: str, *, level: str, detail: str, **_: Any) -> None:
        self.lines.append((state, level, detail))

    @property
    def monitor(self) -> HealthMonitor:
        return cast(HealthMonitor, self)


def test_a_condition_is_over_after_its_hold_time() -> None:
    reported = Reported()

    async def main(loop: VirtualLoop) -> None:
        condition = HeldCondition(reported.monitor, "files", "their own")
        condition.raise_fault("lost", "error", "gone")
        condition.clear()
        await asyncio.sleep(HOLD_S - 0.1)
        assert reported.lines == [("lost", "error", "gone")]
        await asyncio.sleep(0.2)
        assert reported.lines[1:] == [("ok", "ok", "")]

    run(main)


def test_recurring_or_closed_condition_does_not_end() -> None:
    reported = Reported()

    async def main(loop: VirtualLoop) -> None:
        condition = HeldCondition(reported.monitor, "files", "their own")
        condition.raise_fault("lost", "error", "gone")
        condition.clear()
        condition.raise_fault("lost", "error", "gone again")
        await asyncio.sleep(2 * HOLD_S)
        condition.clear()
        condition.close()
        await asyncio.sleep(2 * HOLD_S)

    run(main)
    assert [detail for _, _, detail in reported.lines] == ["gone", "gone again"]


DAMAGES: list[tuple[Damage, list[tuple[str, str, str]]]] = [
    (
        Damage(("a", "b"), ()),
        [("restored", "warn", "removed while the node ran, and made again: a; b"), ("ok", "ok", "")],
    ),
    (
        Damage(tuple("abcde"), ()),
        [
            ("restored", "warn", "removed while the node ran, and made again: a; b; c and 2 more"),
            ("ok", "ok", ""),
        ],
    ),
    (Damage(("a",), ("b: no room",)), [("lost", "error", "b: no room")]),
    (Damage((), ()), [("ok", "ok", "")]),
]


@pytest.mark.parametrize(("damage", "expected"), DAMAGES)
def test_lasting_damage_is_error_then_warning(damage: Damage, expected: list[tuple[str, str, str]]) -> None:
    reported = Reported()

    async def main(loop: VirtualLoop) -> None:
        report = DamageReport(reported.monitor)
        report.on_damage(damage)
        await asyncio.sleep(2 * HOLD_S)
        report.close()

    run(main)
    assert reported.lines == expected
