"""The table of modes, every cell, and the core that applies it."""

import itertools
import math
from pathlib import Path

import pytest

from swarmd.control.config import Config
from swarmd.control.core.control import HOLD_NS, Action, ControlCore, Operator, PublishMode, WriteDrive
from swarmd.control.core.modes import DECISIONS, TRANSITIONS, Source
from swarmware.errors import Denied, InvalidInput
from swarmware.model.config import load
from swarmware.types.control import ControlState, Drive, DriveEvent, DriveMode, DriveRequest
from swarmware.types.vehicle import Setpoint, VehicleMode

ANNA = Operator(7, "anna@gcs")
BERT = Operator(8, "bert@gcs")
FORWARD = Setpoint(1.0)
S = 1_000_000_000
NOW = 100 * S

AUTO, MANUAL, HOLD, PILOT = DriveMode.AUTO, DriveMode.MANUAL, DriveMode.HOLD, DriveMode.PILOT

DRIVES = {
    AUTO: {Source.NAVIGATOR},
    MANUAL: {Source.OPERATOR},
    HOLD: {Source.OPERATOR},
    PILOT: {Source.PILOT},
}
"""Whose set-points reach the chassis in each mode: exactly one source, as ADR 41 says."""
REFUSED = {(AUTO, Source.OPERATOR), (PILOT, Source.OPERATOR)}
"""An operator without the stick is told so; set-points that nobody watches are ignored."""
NEXT = """
         drive   setpoint  expired  release  order   recovery  switch_manual  switch_auto
auto     manual  refused   auto     auto     auto    auto      pilot          auto
manual   manual  manual    hold     auto     auto    refused   pilot          manual
hold     manual  manual    hold     auto     auto    auto      pilot          hold
pilot    refused refused   pilot    pilot    refused refused   pilot          auto
"""
"""Mode after each event, written down a second time: a test by the shipped table would prove nothing."""


def cells() -> dict[tuple[DriveMode, DriveEvent], DriveMode | None]:
    header, *rows = (line.split() for line in NEXT.strip().splitlines())
    return {
        (DriveMode(mode), DriveEvent(event)): None if after == "refused" else DriveMode(after)
        for mode, *afters in rows
        for event, after in zip(header, afters, strict=True)
    }


def core_in(mode: DriveMode, config: Config | None = None) -> ControlCore:
    """Creates a core in this mode; in manual and hold, anna has the stick."""
    core = ControlCore(config or Config())
    if mode in (MANUAL, HOLD):
        core.on_request(DriveRequest(DriveEvent.DRIVE), ANNA, NOW - S)
        core.on_manual(FORWARD, ANNA.id, NOW - 1000, NOW - 1000)
    if mode is HOLD:
        core.on_timer(NOW + S)
    if mode is PILOT:
        core.on_switch(VehicleMode.MANUAL, NOW)
    assert core.state.mode is mode
    return core


def drives(actions: list[Action]) -> list[Drive]:
    return [action.drive for action in actions if isinstance(action, WriteDrive)]


def states(actions: list[Action]) -> list[ControlState]:
    return [action.state for action in actions if isinstance(action, PublishMode)]


def test_the_tables_have_every_cell() -> None:
    assert set(TRANSITIONS) == set(cells()) == set(itertools.product(DriveMode, DriveEvent))
    assert set(DECISIONS) == set(itertools.product(DriveMode, Source))


@pytest.mark.parametrize(("mode", "source"), list(itertools.product(DriveMode, Source)), ids=str)
def test_set_point_comes_from_driving_source_alone(mode: DriveMode, source: Source) -> None:
    core = core_in(mode)
    if source is Source.NAVIGATOR:
        found = drives(core.on_setpoint(FORWARD, NOW + 2 * S, NOW + 2 * S))
    elif source is Source.PILOT:
        found = drives(core.on_sticks(FORWARD, NOW + 2 * S, NOW + 2 * S))
    else:
        found = drives(core.on_manual(FORWARD, ANNA.id, NOW + 2 * S, NOW + 2 * S))
    passed = source in DRIVES[mode]
    assert bool(found) is passed
    assert all(drive.setpoint == FORWARD for drive in found)
    if passed:
        assert found[0].source == (ANNA.name if source is Source.OPERATOR else source.value)
    assert core.refused == ((mode, source) in REFUSED)


@pytest.mark.parametrize(("mode", "event"), cells(), ids=str)
def test_each_event_leads_to_documented_mode(mode: DriveMode, event: DriveEvent) -> None:
    core = core_in(mode)
    expected = cells()[mode, event]
    now = NOW + 2 * S
    match event:
        case DriveEvent.SWITCH_MANUAL | DriveEvent.SWITCH_AUTO:
            position = VehicleMode.MANUAL if event is DriveEvent.SWITCH_MANUAL else VehicleMode.AUTO
            core.on_switch(position, now)
        case DriveEvent.SETPOINT:
            core.on_manual(FORWARD, ANNA.id, now, now)
        case DriveEvent.EXPIRED:
            core.on_timer(now)
        case _ if expected is None:
            with pytest.raises(Denied):
                core.on_request(DriveRequest(event), ANNA, now)
        case _:
            core.on_request(DriveRequest(event), ANNA, now)
    assert core.state.mode is (mode if expected is None else expected)
    assert bool(core.state.holder) is (core.state.mode in (MANUAL, HOLD))


def test_set_point_of_navigator_keeps_its_stamp() -> None:
    core = ControlCore(Config())
    assert core.on_setpoint(FORWARD, NOW - 5, NOW) == [
        WriteDrive(Drive(1.0, mode=AUTO, source="navigator"), NOW - 5)
    ]
    assert core.deadline_ns() is None


def test_vehicle_holds_after_manual_set_points_time_out() -> None:
    core = core_in(MANUAL)
    core.on_manual(FORWARD, ANNA.id, NOW, NOW + 50)
    due = core.deadline_ns()
    assert due == NOW + round(0.3 * S)
    assert core.on_timer(due - 1) == []
    actions = core.on_timer(due)
    assert drives(actions) == [Drive(0.0, mode=HOLD)]
    assert states(actions) == [ControlState(HOLD, ANNA.name, ANNA.id, due, "expired")]
    assert core.deadline_ns() == due + HOLD_NS
    assert drives(core.on_timer(due + HOLD_NS)) == [Drive(0.0, mode=HOLD)]


def test_stick_without_set_point_stops_vehicle_then_holds() -> None:
    core = ControlCore(Config())
    actions = core.on_request(DriveRequest(DriveEvent.DRIVE), ANNA, NOW)
    assert drives(actions) == [Drive(0.0, mode=MANUAL, source=ANNA.name)]
    core.on_timer(NOW + S)
    assert core.state.mode is HOLD


def test_late_set_point_is_counted_and_not_executed() -> None:
    core = core_in(MANUAL)
    assert core.on_manual(FORWARD, ANNA.id, NOW, NOW + round(0.31 * S)) == []
    assert (core.expired, core.refused) == (1, 0)


def test_overtaken_set_point_is_not_executed() -> None:
    core = core_in(MANUAL)
    core.on_manual(Setpoint(0.0), ANNA.id, NOW + 200, NOW + 300)
    assert core.on_manual(FORWARD, ANNA.id, NOW + 100, NOW + 300) == []


def test_stamp_of_future_does_not_hold_stick_longer() -> None:
    core = core_in(MANUAL)
    core.on_manual(FORWARD, ANNA.id, NOW + 60 * S, NOW)
    assert core.deadline_ns() == NOW + round(0.3 * S)


def test_first_operator_holds_stick_and_is_named() -> None:
    core = core_in(MANUAL)
    with pytest.raises(Denied, match="anna@gcs has the stick; --take takes the stick"):
        core.on_request(DriveRequest(DriveEvent.DRIVE), BERT, NOW)
    assert core.on_manual(FORWARD, BERT.id, NOW, NOW) == []
    assert core.state.holder == ANNA.name
    with pytest.raises(Denied, match="anna@gcs has the stick"):
        core.on_request(DriveRequest(DriveEvent.RELEASE), BERT, NOW)


def test_stick_of_unreachable_operator_is_taken_explicitly() -> None:
    core = core_in(HOLD)
    with pytest.raises(Denied, match="anna@gcs has the stick"):
        core.on_request(DriveRequest(DriveEvent.DRIVE), BERT, NOW + 9 * S)


def test_operator_taking_stick_drives_alone() -> None:
    core = core_in(MANUAL)
    actions = core.on_request(DriveRequest(DriveEvent.DRIVE, take=True), BERT, NOW)
    assert states(actions) == [ControlState(MANUAL, BERT.name, BERT.id, NOW, "drive")]
    assert core.on_manual(FORWARD, ANNA.id, NOW + 1, NOW + 1) == []
    assert drives(core.on_manual(FORWARD, BERT.id, NOW + 1, NOW + 1))[0].source == BERT.name


def test_operator_who_has_stick_may_ask_again() -> None:
    core = core_in(MANUAL)
    core.on_request(DriveRequest(DriveEvent.DRIVE), ANNA, NOW)
    assert core.state.holder == ANNA.name


def test_order_takes_stick_from_its_holder() -> None:
    core = core_in(MANUAL)
    core.on_request(DriveRequest(DriveEvent.ORDER), BERT, NOW)
    assert core.state == ControlState(AUTO, "", 0, NOW, "order")
    assert core.on_manual(FORWARD, ANNA.id, NOW + 1, NOW + 1) == []
    assert core.refused == 1


def test_safety_pilot_takes_stick_until_switched_back() -> None:
    core = core_in(MANUAL)
    actions = core.on_switch(VehicleMode.MANUAL, NOW)
    assert drives(actions) == [Drive(0.0, mode=PILOT)]
    with pytest.raises(Denied, match="the safety pilot drives, the switch of the vehicle is at manual"):
        core.on_request(DriveRequest(DriveEvent.DRIVE, take=True), BERT, NOW)
    core.on_switch(VehicleMode.AUTO, NOW + S)
    assert core.state == ControlState(AUTO, "", 0, NOW + S, "switch_auto")


def test_switch_at_unknown_position_gives_vehicle_to_pilot() -> None:
    core = ControlCore(Config())
    core.on_switch(VehicleMode("sport"), NOW)
    assert core.state.mode is PILOT


def test_switch_that_reports_its_position_again_changes_nothing() -> None:
    core = ControlCore(Config())
    assert core.on_switch(VehicleMode.AUTO, NOW) == []
    core.on_switch(VehicleMode.MANUAL, NOW)
    assert core.on_switch(VehicleMode.MANUAL, NOW + S) == []


@pytest.mark.parametrize("event", ["setpoint", "expired", "switch_auto", "switch_manual", "later"])
def test_events_of_the_vehicle_itself_cannot_be_requested(event: str) -> None:
    with pytest.raises(InvalidInput, match="expected one of drive, release, order, recovery"):
        core_in(PILOT).on_request(DriveRequest(DriveEvent(event)), ANNA, NOW)


def test_manual_set_points_are_limited_in_direction() -> None:
    core = core_in(MANUAL)
    drive = drives(core.on_manual(Setpoint(30.0, 40.0, -9.0, 9.0), ANNA.id, NOW, NOW))[0]
    assert math.hypot(drive.vx_m_s, drive.vy_m_s) == pytest.approx(3.0)
    assert drive.vx_m_s == pytest.approx(1.8)
    assert (drive.vz_m_s, drive.wz_rad_s) == (-1.5, 1.0)


@pytest.mark.parametrize(
    ("former", "mode"), [(AUTO, AUTO), (MANUAL, HOLD), (HOLD, HOLD), (PILOT, PILOT), (DriveMode("x"), AUTO)]
)
def test_restarted_daemon_continues_mode_and_driven_vehicle_holds(former: DriveMode, mode: DriveMode) -> None:
    core = ControlCore(Config(), ControlState(former, ANNA.name, ANNA.id, 1, "drive"))
    assert core.state.mode is mode
    if mode is HOLD:
        assert drives(core.on_timer(NOW)) == [Drive(0.0, mode=HOLD)]
        assert drives(core.on_manual(FORWARD, ANNA.id, NOW, NOW))  # the operator still has the stick


def test_the_shipped_file_has_the_defaults() -> None:
    assert load(Path(__file__).parents[3] / "etc/swarm/services/control.toml", Config) == Config()


def test_safety_pilot_drives_and_absence_holds() -> None:
    core = core_in(PILOT)
    core.on_timer(NOW)
    assert core.on_sticks(FORWARD, NOW - S, NOW) == [], "a set-point that was under way for too long"
    assert core.expired == 1
    (drive,) = drives(core.on_sticks(Setpoint(100.0), NOW, NOW))
    assert drive == Drive(Config().speed_max_m_s, mode=PILOT, source="pilot")
    silent_ns = NOW + round(Config().manual_timeout_s * S)
    assert core.deadline_ns() == silent_ns
    assert core.on_timer(silent_ns - 1) == []
    assert drives(core.on_timer(silent_ns)) == [Drive(0.0, mode=PILOT)]
    assert core.deadline_ns() == silent_ns + HOLD_NS
    core.on_sticks(FORWARD, silent_ns, silent_ns)
    core.on_switch(VehicleMode.AUTO, silent_ns + 1)
    assert core.deadline_ns() is None
    assert core.on_sticks(FORWARD, silent_ns + 2, silent_ns + 2) == []
    assert drives(core.on_switch(VehicleMode.MANUAL, silent_ns + 3)) == [Drive(0.0, mode=PILOT)]
