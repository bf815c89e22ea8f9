"""Faults of a flight in loop, tilt and contact: their duration and their freeze frames."""

import pytest

from swarmd.hal.core.condition import Condition
from swarmd.hal.core.flight.flight_state import FlightState
from swarmd.hal.core.flight.flight_watch import SHOWN_NS, FlightStep, FlightWatch

MS = 1_000_000
NONE = (0.0, 0.0, 0.0)


class Watched:
    """A watch of a loop with 100 Hz that has flown for two seconds."""

    def __init__(self, landed_first: bool = True) -> None:
        self.watch = FlightWatch(0.01, 0.7, 1.0)
        self.now_ns = 0
        self.first = self.watch.conditions(0)
        if landed_first:
            self.step(landed=True)
        for _ in range(200):
            self.step()

    def step(
        self, gap_s: float = 0.01, *, roll_rad: float = 0.0, climb_m_s: float = 0.0, landed: bool = False
    ) -> bool:
        self.now_ns += round(gap_s * 1e9)
        state = FlightState(roll_rad, 0.0, 0.0, NONE, (0.0, 0.0, 4.2), (0.0, 0.0, -1.3))
        return self.watch.on_step(FlightStep(state, gap_s, climb_m_s, landed), self.now_ns)

    def changed(self) -> list[tuple[str, str, str]]:
        return [(one.name, one.state, one.level) for one in self.watch.conditions(self.now_ns)]


def test_all_checks_exist_from_the_start() -> None:
    flight = Watched()
    assert [(one.name, one.state) for one in flight.first] == [
        ("flight/loop", "ok"),
        ("flight/tilt", "ok"),
        ("flight/contact", "ok"),
    ]
    assert all(isinstance(one, Condition) and one.description for one in flight.first)
    assert flight.changed() == []


@pytest.mark.parametrize(
    ("gap_s", "expected"),
    [
        (0.04, []),
        (0.051, [("flight/loop", "late", "warn")]),
        (0.49, [("flight/loop", "late", "warn")]),
        (0.5, [("flight/loop", "away", "error")]),
        (1.4, [("flight/loop", "away", "error")]),
    ],
)
def test_gap_is_fault_then_error_by_length(gap_s: float, expected: list[tuple[str, str, str]]) -> None:
    flight = Watched()
    flight.step(gap_s)
    assert flight.changed() == expected


def test_freeze_frame_has_duration_and_position() -> None:
    flight = Watched()
    flight.step(1.2, roll_rad=0.2)
    (found,) = flight.watch.conditions(flight.now_ns)
    assert found.detail == (
        "1.20 s without a step, 120 periods, motors stopped in it; 1.2 s of the last 3;"
        " height 4.2 m, climb -1.3 m/s, tilt 11°"
    )


def test_loop_of_three_hertz_is_starved() -> None:
    flight = Watched()
    for _ in range(3):
        flight.step(0.33)
    assert flight.changed() == [("flight/loop", "late", "warn")]
    flight.step(0.33)
    assert flight.changed() == [("flight/loop", "starved", "error")]


def test_fault_lasts_three_seconds_unless_greater_follows() -> None:
    flight = Watched()
    flight.step(0.6)
    flight.changed()
    flight.step(0.1)
    assert flight.changed() == []
    flight.now_ns += SHOWN_NS - 200 * MS
    assert flight.changed() == []
    flight.now_ns += 200 * MS
    assert flight.changed() == [("flight/loop", "ok", "ok")]


def test_a_tilt_beyond_the_limit_is_a_fault() -> None:
    flight = Watched()
    flight.step(roll_rad=0.69)
    assert flight.changed() == []
    flight.step(roll_rad=-0.75)
    (found,) = flight.watch.conditions(flight.now_ns)
    assert (found.name, found.state, found.level) == ("flight/tilt", "beyond", "error")
    assert found.detail == "tilt 43°, limit 40°; height 4.2 m, climb -1.3 m/s"


@pytest.mark.parametrize(
    ("climb_m_s", "touched"), [(0.0, True), (0.5, True), (-0.04, True), (-0.3, False), (-1.0, False)]
)
def test_ground_is_touched_unexpectedly_unless_descent_is_commanded(climb_m_s: float, touched: bool) -> None:
    flight = Watched()
    assert flight.step(climb_m_s=climb_m_s, landed=True) is touched
    assert flight.changed() == ([("flight/contact", "touched", "error")] if touched else [])
    assert not flight.step(climb_m_s=climb_m_s, landed=True), "it is said once"


def test_take_off_that_touches_ground_is_cancelled() -> None:
    watch = FlightWatch(0.01, 0.7, 1.0)
    state = FlightState(0.0, 0.0, 0.0, NONE, NONE, NONE)
    for ms, landed in ((0, True), (10, False), (20, False), (30, True)):
        assert not watch.on_step(FlightStep(state, 0.01, 1.0, landed), ms * MS)


def test_gaps_on_ground_do_not_count() -> None:
    flight = Watched()
    flight.step(climb_m_s=-1.0, landed=True)
    flight.step(2.0, landed=True)
    flight.watch.on_disarmed()
    flight.step(0.7)
    assert flight.changed() == []


def test_adopted_flight_begins_with_its_gap() -> None:
    watch = FlightWatch(0.01, 0.7, 1.0)
    watch.conditions(0)
    watch.on_handover(0)
    state = FlightState(0.0, 0.0, 0.0, NONE, NONE, NONE)
    watch.on_step(FlightStep(state, 0.7, 0.0, False), 700 * MS)
    assert [one.state for one in watch.conditions(700 * MS)] == ["away"]
