"""Which message of an epoch gives the fix."""

import math

import pytest

from swarmware.devices.gnss_epochs import KINDS, Epochs, Position, between_s
from swarmware.types.vehicle import GnssFix

FLAT = frozenset({"RMC", "GLL"})


def message(kind: str, time_s: float, *, fix: bool = True) -> Position:
    height_m = math.nan if kind in FLAT else 100.0
    return Position(kind, time_s, GnssFix(48.0, 11.0, height_m, 1.0, 8) if fix else None)


def given(epochs: Epochs, second: float, kinds: str) -> list[str]:
    """The kinds that give fixes in one epoch; a lower-case name has none."""
    sent = [message(kind.upper(), second, fix=kind.isupper()) for kind in kinds.split()]
    return [position.kind for position in sent if epochs.take(position) is not None]


@pytest.mark.parametrize(
    ("each", "first", "later"),
    [
        ("GGA", ["GGA"], ["GGA"]),
        ("RMC", [], ["RMC"]),
        ("GLL", [], ["GLL"]),
        ("GNS", ["GNS"], ["GNS"]),
        ("PVT", ["PVT"], ["PVT"]),
        ("RMC GGA GLL", ["GGA"], ["GGA"]),
        ("GGA RMC", ["GGA"], ["GGA"]),
        ("RMC GLL", [], ["RMC"]),
        ("GLL RMC", [], ["RMC"]),
        ("GNS RMC", ["GNS"], ["GNS"]),
        ("GNS GGA", ["GNS"], ["GGA"]),
        ("GGA GNS", ["GGA"], ["GGA"]),
        ("RMC GGA PVT", ["GGA"], ["PVT"]),
        ("PVT GGA RMC", ["PVT"], ["PVT"]),
        ("RMC gga", [], []),
        ("gga RMC", [], []),
        ("pvt GGA", [], []),
    ],
)
def test_each_epoch_has_one_fix_of_best_message(each: str, first: list[str], later: list[str]) -> None:
    epochs = Epochs()
    assert given(epochs, 1.0, each) == first
    for second in range(2, 12):
        assert given(epochs, float(second), each) == later


def test_another_message_gives_fixes_when_better_one_ends() -> None:
    epochs = Epochs()
    for second in range(3):
        assert given(epochs, float(second), "RMC GGA") == ["GGA"]
    assert given(epochs, 3.0, "RMC") == []
    assert given(epochs, 4.0, "RMC") == ["RMC"]
    assert given(epochs, 5.0, "RMC GGA") == ["RMC", "GGA"], "the height is new"
    assert given(epochs, 6.0, "RMC GGA") == ["GGA"]


def test_the_time_between_epochs_passes_midnight() -> None:
    assert between_s(86_399.5, 0.25) == pytest.approx(0.75)
    assert between_s(0.25, 86_399.5) == pytest.approx(0.75)
    assert between_s(100.0, 40.0) == 60.0
    assert between_s(0.0, 43_200.0) == 43_200.0


def test_the_kinds_without_height_are_the_last_ones() -> None:
    assert frozenset(KINDS[3:]) == FLAT
