"""Values of other computers of this platform are counted with their delays; other platforms are ignored."""

import pytest

from swarmd.tree.core.values.input_meter import InputMeter
from swarmware.model.frame import FrameKind
from swarmware.model.names import Address
from swarmware.types.tree_exchange import TreeItem

MS = 1_000_000


def item(path: str, stamp_ns: int, size: int = 10) -> TreeItem:
    return TreeItem(path, 7, FrameKind.BOARD, 1, stamp_ns, bytes(size))


def to_local(hardware: int, stamp_ns: int) -> int | None:
    """The clock of hardware 5 is 100 ms ahead; any other clock is not known."""
    return stamp_ns - 100 * MS if hardware == 5 else None


def test_delays_are_those_on_the_own_clock() -> None:
    meter = InputMeter(Address("uav1", "main"), to_local)
    meter.on_items("uav1.nav", 5, [item("nav/pose", 103 * MS), item("nav/status", 101 * MS)], 5 * MS)
    meter.on_items("uav1.nav", 5, [item("nav/pose", 110 * MS, 30)], 18 * MS)
    meter.on_items("uav1.nav", 5, [item("nav/pose", 130 * MS)], 29 * MS)
    pose = meter.counts["nav", "nav/pose"]
    assert (pose.values, pose.payload_bytes) == (3, 50)
    assert (pose.quantile_ms(0.5), pose.quantile_ms(1.0)) == (2.0, 8.0)
    assert pose.mean_ms == pytest.approx(10 / 3), "a clock that is ahead by its error gives no negative delay"
    assert meter.counts["nav", "nav/status"].quantile_ms(1.0) == 4.0


def test_values_without_clock_count_without_delay() -> None:
    meter = InputMeter(Address("uav1", "main"), to_local)
    meter.on_items("uav1.fc", 6, [item("sensor/imu", 1)], 2)
    found = meter.counts["fc", "sensor/imu"]
    assert (found.values, found.mean_ms, found.quantile_ms(1.0)) == (1, None, None)


def test_other_platforms_are_not_counted() -> None:
    meter = InputMeter(Address("uav1", "main"), to_local)
    meter.on_items("uav2", 5, [item("nav/pose", 1)], 2)
    assert meter.counts == {}
