"""A condition of a moment is reported long enough to be seen; files that were removed are one."""

import asyncio
from typing import Any, cast

import pytest

from swarmware.health import held_condition
from swarmware.health.held_condition import HeldCondition
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


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(held_condition, "HOLD_S", 0.02)


async def test_a_condition_stays_for_a_while_after_it_is_over() -> None:
    reported = Reported()
    condition = HeldCondition(reported.monitor, "files", "their own")
    condition.raise_fault("lost", "error", "gone")
    condition.clear()
    assert reported.lines == [("lost", "error", "gone")]
    await asyncio.sleep(0.1)
    assert reported.lines[1:] == [("ok", "ok", "")]


async def test_a_condition_that_occurs_again_is_not_over_and_a_closed_one_says_nothing() -> None:
    reported = Reported()
    condition = HeldCondition(reported.monitor, "files", "their own")
    condition.raise_fault("lost", "error", "gone")
    condition.clear()
    condition.raise_fault("lost", "error", "gone again")
    await asyncio.sleep(0.1)
    condition.clear()
    condition.close()
    await asyncio.sleep(0.1)
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
async def test_damage_is_an_error_while_it_lasts_and_a_warning_after_it(
    damage: Damage, expected: list[tuple[str, str, str]]
) -> None:
    reported = Reported()
    report = DamageReport(reported.monitor)
    report.on_damage(damage)
    await asyncio.sleep(0.1)
    assert reported.lines == expected
    report.close()
