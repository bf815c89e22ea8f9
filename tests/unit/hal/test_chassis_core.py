"""Orders to a chassis are repeated until they are answered; its set-points are guarded by a watchdog."""

from typing import Final

import pytest

from swarmd.hal.core.chassis_core import REPEAT_NS, SILENT_NS, STOP, ChassisCore, DriveOutput
from swarmware.types.chassis import ChassisAction, ChassisReport
from swarmware.types.vehicle import Setpoint

S: Final = 1_000_000_000
ARM, DISARM, KILL, GAINS = ChassisAction.ARM, ChassisAction.DISARM, ChassisAction.KILL, ChassisAction.GAINS
ARMED: Final = ChassisReport(armed=True, landed=False)


def opened(report: ChassisReport | None = None) -> ChassisCore:
    core = ChassisCore(watchdog_s=0.5)
    core.on_opened(10 * S)
    if report is not None:
        core.on_report(report, 10 * S)
    return core


def test_order_is_repeated_until_report_answers_it() -> None:
    core = opened()
    order = core.on_order(ARM, 10 * S)
    assert core.repeated(10 * S + REPEAT_NS - 1) == []
    assert core.repeated(10 * S + REPEAT_NS) == [order]
    assert core.repeated(10 * S + REPEAT_NS + 1) == []
    assert core.answer(order) is None
    core.on_report(ChassisReport(armed=True, landed=True, answered=order.number), 11 * S)
    answer = core.answer(order)
    assert answer is not None
    assert (answer.armed, answer.refused) == (True, "")
    assert core.repeated(20 * S) == []


def test_order_numbers_rise_within_instant_and_restart() -> None:
    core = opened()
    numbers = [core.on_order(GAINS, 10 * S).number for _ in range(3)]
    assert numbers == sorted(set(numbers))
    restarted = opened()
    assert restarted.on_order(ARM, 11 * S).number > numbers[-1]


@pytest.mark.parametrize(
    ("first", "armed", "refused"),
    [(ARM, False, True), (ARM, True, True), (DISARM, False, False), (KILL, False, False), (KILL, True, True)],
)
def test_overtaken_order_succeeds_only_when_both_stop(
    first: ChassisAction, armed: bool, refused: bool
) -> None:
    core = opened()
    order = core.on_order(first, 10 * S)
    later = core.on_order(KILL, 10 * S)
    assert core.repeated(10 * S + REPEAT_NS) == [later], "no repetition arms a killed vehicle"
    core.on_report(ChassisReport(armed=armed, landed=True, answered=later.number), 10 * S)
    answer = core.answer(order)
    assert answer is not None
    assert bool(answer.refused) is refused


def test_motor_order_does_not_end_gain_order() -> None:
    core = opened()
    gains = core.on_order(GAINS, 10 * S, {"rate_kp": 0.2})
    kill = core.on_order(KILL, 10 * S)
    assert core.repeated(10 * S + REPEAT_NS) == [gains, kill]
    core.forget(gains)
    assert core.repeated(10 * S + 2 * REPEAT_NS) == [kill]


def test_set_point_is_sent_once_with_its_instant() -> None:
    core = opened(ARMED)
    core.on_setpoint(Setpoint(1.0), 10 * S + 5)
    assert core.output(10 * S + 9) == DriveOutput(Setpoint(1.0), 10 * S + 5)
    assert core.output(10 * S + 10) is None


@pytest.mark.parametrize("begun", [True, False])
def test_armed_chassis_without_set_points_is_stopped(begun: bool) -> None:
    core = opened(ARMED)
    now_ns = 10 * S
    if begun:
        core.on_setpoint(Setpoint(1.0), now_ns)
        core.output(now_ns)
        assert core.output(now_ns + S // 2) is None
        assert not core.failsafe(now_ns + S // 2)
    now_ns += S // 2 + 1
    assert core.failsafe(now_ns)
    assert core.output(now_ns) == DriveOutput(STOP, now_ns)
    assert core.output(now_ns + S) == DriveOutput(STOP, now_ns + S), "as long as it lasts"
    core.on_setpoint(Setpoint(2.0), now_ns + S)
    assert core.output(now_ns + S) == DriveOutput(Setpoint(2.0), now_ns + S)
    assert not core.failsafe(now_ns + S)


def test_disarmed_or_unknown_chassis_has_no_fail_safe() -> None:
    assert not opened().failsafe(100 * S)
    assert not opened(ChassisReport(armed=False, landed=True)).failsafe(100 * S)


def test_silent_chassis_is_lost_despite_ended_report() -> None:
    core = opened()
    core.on_report(ARMED, 10 * S - SILENT_NS - 1)
    assert core.report is None
    assert not core.silent(10 * S + SILENT_NS)
    assert core.silent(10 * S + SILENT_NS + 1)
    core.on_report(ARMED, 12 * S)
    assert not core.silent(12 * S + SILENT_NS)


def test_opened_chassis_has_no_former_orders() -> None:
    core = opened(ARMED)
    core.on_order(ARM, 10 * S)
    core.on_setpoint(Setpoint(1.0), 10 * S)
    core.on_opened(20 * S)
    assert core.report is None
    assert core.repeated(30 * S) == []
    assert core.output(20 * S) is None
