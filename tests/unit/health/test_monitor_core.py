"""Monitor core: faults and the state of the platform after samples, reports and ends of processes."""

import msgspec
from tests.unit.health.monitor import SECOND, Monitor, look, monitor, present, told

from swarmd.health.core.faults import CheckSample
from swarmd.health.core.monitor import (
    FaultsCleared,
    GuardHung,
    ReadInputs,
    RegistrationChanged,
)
from swarmware.model.resource import Resource
from swarmware.types.health import CheckRegistration, CheckReport, CheckReports, Fault, Phase, StateRule
from swarmware.types.system import AppState, AppStatus

POSE = Resource(path="nav/pose", type="Pose", rate_hz=20, critical=True)
GNSS = Resource(path="sensor/gnss", type="GnssFix", rate_hz=10)
BATTERY = Resource(path="power/battery", type="BatteryState", rate_hz=1)


def beat(
    core: Monitor,
    number: int,
    now_ns: int,
    *,
    app: str = "hal",
    pid: int = 7,
    restarts: int = 0,
    failures: int = 0,
) -> None:
    found = core.apps.get(f"{app}#1")
    assert found is not None
    core.on_status(found, AppStatus(pid, AppState.RUNNING, number, restarts, failures=failures), now_ns)


def cleared(core: Monitor, pattern: str, now_ns: int) -> tuple[Fault, ...]:
    (found,) = [action for action in core.on_clear(pattern, now_ns) if isinstance(action, FaultsCleared)]
    return found.faults


def test_resource_is_fresh_then_stale_then_lost() -> None:
    core = monitor()
    present(core, POSE)
    for half in range(30):
        look(core, "nav/pose", half, half * SECOND // 2)
    assert told(core) == []
    assert core.state().sensors == {"nav/pose": True}
    for half in range(30, 33):
        look(core, "nav/pose", 29, half * SECOND // 2)
    assert told(core) == [("age/nav/pose", "stale", Phase.CONFIRMED)]
    assert core.state().level == "warn"
    assert core.state().sensors == {"nav/pose": False}
    for half in range(33, 40):
        look(core, "nav/pose", 29, half * SECOND // 2)
    assert told(core) == [("age/nav/pose", "lost", Phase.CONFIRMED)]
    assert core.state().level == "error"
    for half in range(40, 43):
        look(core, "nav/pose", half, half * SECOND // 2)
    assert told(core) == [("age/nav/pose", "lost", Phase.HEALED)]
    assert core.state().level == "ok"
    core.on_inputs_read(30 * SECOND)
    assert told(core) == [("age/nav/pose", "lost", Phase.CLEARED)]


def test_nothing_is_said_during_the_start() -> None:
    core = monitor()
    present(core, POSE)
    for half in range(20):
        look(core, "nav/pose", -1, half * SECOND // 2)
    assert told(core) == []
    for half in range(20, 24):
        look(core, "nav/pose", -1, half * SECOND // 2)
    assert [check for check, *_ in told(core)] == ["age/nav/pose"]


def test_ignored_or_rateless_resource_is_not_judged() -> None:
    core = monitor()
    present(
        core,
        Resource(path="app/hal/status", type="AppStatus", rate_hz=1),
        Resource(path="nav/goal", type="Goal"),
    )
    assert core.ages() == []


def test_promised_sensor_without_provider_is_invalid_without_fault() -> None:
    core = monitor()
    core.set_template((GNSS, BATTERY))
    assert core.state().sensors == {"sensor/gnss": False}
    assert core.state().level == "ok"


def test_low_battery_needs_several_checks_and_hysteresis() -> None:
    core = monitor(grace_s=0.0)
    present(core, BATTERY)
    rule = next(rule for rule in core.limits() if rule.check == "battery/charge")
    assert core.state().battery == "unknown"
    look(core, "power/battery", 1, 0)
    for second, value in enumerate([0.5, 0.29, 0.29, 0.29]):
        core.on_value(rule, value, second * SECOND)
    assert told(core) == [("battery/charge", "warn", Phase.CONFIRMED)]
    assert (core.state().battery, core.state().battery_ratio) == ("low", 0.3)
    for second in range(4, 8):
        core.on_value(rule, 0.1, second * SECOND)
    assert told(core) == [("battery/charge", "error", Phase.CONFIRMED)]
    assert core.state().battery == "critical"
    for second in range(8, 14):
        core.on_value(rule, 0.9, second * SECOND)
    assert [phase for *_, phase in told(core)] == [Phase.HEALED]
    assert core.state().battery == "ok"


def test_sensor_value_beyond_limits_is_invalid() -> None:
    core = monitor(grace_s=0.0)
    present(core, GNSS)
    look(core, "sensor/gnss", 1, 0)
    assert core.state().sensors["sensor/gnss"]
    rule = next(rule for rule in core.limits() if rule.check == "gnss/satellites")
    for second in range(3):
        core.on_value(rule, 3.0, second * SECOND)
    assert not core.state().sensors["sensor/gnss"]


def test_unannounced_death_is_fault_until_return() -> None:
    core = monitor()
    present(core, BATTERY)
    beat(core, 1, 0)
    core.on_died("hal#1", SECOND)
    assert told(core) == [("app/hal", "died", Phase.CONFIRMED)]
    assert (core.state().apps_alive, core.state().apps_failed) == (0, 1)
    assert [age.path for age in core.ages()] == ["power/battery"]
    present(core, BATTERY, pid=8, at_ns=2 * SECOND)
    assert told(core) == [("app/hal", "died", Phase.HEALED)]
    assert (core.state().apps_alive, core.state().apps_failed) == (1, 0)


def test_leaving_application_is_no_fault_nor_missed() -> None:
    core = monitor()
    present(core, BATTERY)
    beat(core, 1, 0)
    core.on_left("hal#1", SECOND)
    assert told(core) == []
    assert core.ages() == []
    assert core.limits() == []


def test_death_before_first_beat_is_no_fault() -> None:
    core = monitor()
    present(core, app="swarmctl")
    core.on_died("swarmctl#1", SECOND)
    assert told(core) == []


def test_stale_beat_is_hang_unless_excused() -> None:
    core = monitor()
    present(core)
    beat(core, 1, 0)
    core.apps.extend_heartbeats(5 * SECOND)
    beat(core, 1, 5 * SECOND)
    assert told(core) == []
    beat(core, 1, 9 * SECOND)
    assert told(core) == [("app/hal", "hung", Phase.CONFIRMED)]
    beat(core, 2, 10 * SECOND)
    assert told(core) == [("app/hal", "hung", Phase.HEALED)]


def test_service_failing_inside_process_is_reported() -> None:
    core = monitor()
    present(core)
    beat(core, 1, 0)
    core.on_left("hal#1", SECOND)
    present(core, at_ns=SECOND)
    beat(core, 1, SECOND, restarts=1, failures=1)
    assert told(core) == [("app/hal", "failed", Phase.CONFIRMED)]
    beat(core, 2, 2 * SECOND, restarts=1, failures=1)
    assert told(core) == [("app/hal", "failed", Phase.HEALED)]


def test_service_restarted_on_request_is_no_fault() -> None:
    core = monitor()
    present(core)
    beat(core, 1, 0)
    for restarts in (1, 2):
        core.on_left("hal#1", restarts * SECOND)
        present(core, at_ns=restarts * SECOND)
        beat(core, 1, restarts * SECOND, restarts=restarts)
    assert told(core) == []


REGISTRATION = CheckRegistration(
    "planner/path", "planner#1", 2.0, (StateRule("late", "warn"), StateRule("none", "error", ("replan",)))
)


def reports(state: str, *, seen: str = "", app: str = "planner#1") -> CheckReports:
    return CheckReports(app, (CheckReport("planner/path", state, 0, seen, "age 1.2"),))


def test_check_of_module_becomes_leveled_fault() -> None:
    core = monitor()
    assert core.on_registration(REGISTRATION, 0) == [RegistrationChanged(REGISTRATION)]
    assert core.on_registration(REGISTRATION, 0) == []
    core.on_reports(reports("ok"), 0)
    core.on_reports(reports("ok", seen="late"), SECOND)
    assert core.take() == []
    core.on_reports(reports("late"), 2 * SECOND)
    (fault,) = core.take()
    assert fault == Fault(
        "planner/path", "late", "warn", Phase.CONFIRMED, SECOND, 2 * SECOND, 1, "age 1.2", ""
    )
    core.on_reports(reports("ok"), 3 * SECOND)
    assert told(core) == [("planner/path", "late", Phase.HEALED)]


def test_report_that_states_level_overrides_registration() -> None:
    core = monitor()
    core.on_registration(REGISTRATION, 0)
    stated = CheckReport("planner/path", "none", 0, level="warn")
    core.on_reports(CheckReports("planner#1", (stated,)), 0)
    assert [(fault.state, fault.level) for fault in core.take()] == [("none", "warn")]
    core.on_inputs_read(3 * SECOND)
    assert [(fault.state, fault.level) for fault in core.take()] == [("silent", "warn")]


def test_check_that_falls_silent_is_itself_fault() -> None:
    core = monitor()
    core.on_registration(REGISTRATION, 0)
    core.on_inputs_read(2 * SECOND)
    assert told(core) == []
    core.on_inputs_read(3 * SECOND)
    assert told(core) == [("planner/path", "silent", Phase.CONFIRMED)]
    core.on_reports(reports("ok"), 4 * SECOND)
    assert told(core) == [("planner/path", "silent", Phase.HEALED)]


def test_foreign_or_unknown_reports_are_ignored() -> None:
    core = monitor()
    core.on_reports(reports("none"), 0)
    core.on_registration(REGISTRATION, 0)
    core.on_reports(reports("none", app="stranger#1"), 0)
    assert told(core) == []


def test_withdrawn_or_departed_checks_are_gone() -> None:
    core = monitor()
    core.on_registration(REGISTRATION, 0)
    core.on_reports(reports("none"), 0)
    core.on_registration(msgspec.structs.replace(REGISTRATION, withdrawn=True), 1)
    assert [phase for *_, phase in told(core)] == [Phase.CONFIRMED, Phase.CLEARED]
    assert "planner/path" not in core.reports
    core.on_registration(REGISTRATION, 2)
    present(core, app="planner", at_ns=2)
    core.on_left("planner#1", 3)
    assert len(core.reports) == 0


def test_the_worst_check_comes_first() -> None:
    core = monitor()
    core.on_registration(REGISTRATION, 0)
    present(core, BATTERY)
    core.on_reports(reports("none"), 0)
    assert core.checks()[0].check == "planner/path"
    assert {check.level for check in core.checks()[1:]} == {"ok"}


HEAT = Resource(path="motor/heat", type="Float", rate_hz=10)


def lose(core: Monitor, path: str, from_half: int) -> None:
    for half in range(from_half, from_half + 12):
        look(core, path, -1, half * SECOND // 2)


def test_only_what_is_declared_critical_grounds_a_vehicle() -> None:
    core = monitor(grace_s=0.0)
    present(core, HEAT, app="planner")
    lose(core, "motor/heat", 0)
    (fault,) = core.faults.confirmed()
    assert (fault.state, fault.level, core.state().level) == ("lost", "warn", "warn")
    core = monitor(grace_s=0.0)
    core.set_template((msgspec.structs.replace(HEAT, critical=True),))  # as a template says it
    present(core, HEAT, app="planner")
    lose(core, "motor/heat", 0)
    assert core.state().level == "error"


def test_fault_of_vanished_check_is_cleared() -> None:
    core = monitor(grace_s=0.0)
    present(core, HEAT, app="planner")
    lose(core, "motor/heat", 0)
    faults = core.faults.open()
    after = monitor(grace_s=10.0)
    after.on_start((), faults, 0)
    after.on_inputs_read(9 * SECOND)
    assert [fault.check for fault in after.faults.open()] == ["age/motor/heat"]
    after.on_inputs_read(10 * SECOND)
    assert after.faults.open() == ()
    assert told(after) == [("age/motor/heat", "lost", Phase.CLEARED)]


def test_dead_service_stays_fault_for_next_monitor() -> None:
    core = monitor()
    present(core, BATTERY)
    beat(core, 1, 0)
    core.on_died("hal#1", SECOND)
    after = monitor()
    after.on_start((), core.faults.open(), 0)
    after.on_inputs_read(60 * SECOND)
    assert [fault.check for fault in after.faults.confirmed()] == ["app/hal"]
    present(after, BATTERY, pid=8, at_ns=61 * SECOND)
    assert [fault.check for fault in after.faults.confirmed()] == []


def test_check_unregistered_after_restart_is_withdrawn() -> None:
    core = monitor()
    present(core, app="planner", at_ns=0)
    core.on_registration(REGISTRATION, SECOND)
    core.on_reports(reports("none"), SECOND)
    core.on_died("planner#1", 2 * SECOND)
    present(core, app="planner", pid=8, at_ns=3 * SECOND)
    core.on_inputs_read(10 * SECOND)
    assert core.faults.open() == ()
    assert "planner/path" not in core.reports


def test_check_of_blocked_module_is_silent() -> None:
    core = monitor()
    present(core, app="planner", at_ns=SECOND)
    core.on_registration(REGISTRATION, 2 * SECOND)
    core.on_inputs_read(10 * SECOND)
    assert [(fault.check, fault.state) for fault in core.faults.confirmed()] == [("planner/path", "silent")]
    core.on_reports(reports("ok"), 11 * SECOND)
    assert not core.faults.confirmed()
    core.on_died("planner#1", 12 * SECOND)
    present(core, app="planner", pid=8, at_ns=13 * SECOND)
    core.on_registration(REGISTRATION, 14 * SECOND)  # so does its next life
    core.on_inputs_read(20 * SECOND)
    assert [(fault.check, fault.state) for fault in core.faults.confirmed()] == [("planner/path", "silent")]


def test_cleared_fault_ends_and_vanished_is_forgotten() -> None:
    core = monitor(grace_s=0.0)
    present(core, HEAT, app="planner")
    present(core, POSE, app="navigator", pid=9)
    core.on_died("planner#1", 0)
    lose(core, "motor/heat", 0)
    lose(core, "nav/pose", 0)
    core.take()
    assert [fault.check for fault in cleared(core, "age/motor/*", 20 * SECOND)] == ["age/motor/heat"]
    assert [age.path for age in core.ages()] == ["nav/pose"]
    assert [fault.check for fault in cleared(core, "**", 20 * SECOND)] == ["age/nav/pose"]
    assert core.faults.open() == ()
    lose(core, "nav/pose", 40)
    assert core.state().level == "error", "its owner lives: the fault is a new one"


def test_clear_returns_remaining_faults() -> None:
    core = monitor(grace_s=0.0)
    present(core, HEAT, app="planner")
    present(core, POSE, app="navigator", pid=9)
    lose(core, "motor/heat", 0)
    for half in range(40, 52):
        look(core, "motor/heat", half, half * SECOND // 2)
    lose(core, "nav/pose", 0)
    core.faults.on_failed(CheckSample("seen/once", "low", "warn"), 20 * SECOND, confirmed=False)
    before = {fault.check: fault.phase for fault in core.faults.open()}
    assert before == {
        "age/motor/heat": Phase.HEALED,
        "age/nav/pose": Phase.CONFIRMED,
        "seen/once": Phase.PENDING,
    }
    assert {fault.check: fault.phase for fault in cleared(core, "**", 30 * SECOND)} == dict.fromkeys(
        before, Phase.CLEARED
    )


def test_lost_platform_is_fault_until_return() -> None:
    core = monitor()
    core.on_platforms({"uav1", "uav2"}, 0)
    core.on_platforms({"uav1"}, 2 * SECOND)
    assert told(core) == []
    core.on_platforms({"uav1"}, 3 * SECOND)
    assert told(core) == [("platform/uav2", "lost", Phase.CONFIRMED)]
    assert core.state().level == "warn"
    core.on_platforms({"uav1"}, 9 * SECOND)
    assert told(core) == []
    core.on_platforms({"uav1", "uav2"}, 10 * SECOND)
    assert told(core) == [("platform/uav2", "lost", Phase.HEALED)]


def test_lost_platform_survives_restart_until_cleared() -> None:
    core = monitor()
    core.on_platforms({"uav2"}, 0)
    core.on_platforms(set(), 3 * SECOND)
    after = monitor()
    after.on_start((), core.faults.open(), 0)
    after.on_inputs_read(60 * SECOND)
    assert [fault.check for fault in after.faults.confirmed()] == ["platform/uav2"]
    after.on_clear("platform/*", 61 * SECOND)
    after.on_platforms(set(), 90 * SECOND)
    assert after.faults.open() == ()


def test_monitor_checks_twice_per_second_excusing_lateness() -> None:
    core = monitor()
    assert core.deadline_ns() is None
    core.on_start((), (), 0)
    values = []
    for half in range(1, 7):
        assert core.deadline_ns() == half * SECOND // 2
        (look,) = core.on_timer(half * SECOND // 2)
        assert isinstance(look, ReadInputs)
        values.append(look.values)
    assert values == [True, False] * 3
    present(core, at_ns=3 * SECOND)
    beat(core, 1, 3 * SECOND)
    core.on_timer(33 * SECOND)
    assert core.deadline_ns() == 33 * SECOND + SECOND // 2, "what was missed is not made up for"
    beat(core, 1, 33 * SECOND)
    assert told(core) == [], "nobody beat while nobody looked"
    beat(core, 1, 37 * SECOND)
    assert told(core) == [("app/hal", "hung", Phase.CONFIRMED)]


def test_guard_that_hangs_is_reported_once_and_stated() -> None:
    core = monitor()
    assert core.state().guard == "absent"
    present(core, app="guard")
    beat(core, 1, 0, app="guard")
    assert core.state().guard == "alive"
    found = core.apps.get("guard#1")
    status = AppStatus(7, AppState.RUNNING, 1, 0)
    assert GuardHung(7) in core.on_status(found, status, 5 * SECOND)
    assert core.on_status(found, status, 6 * SECOND) == []
    assert core.state().guard == "hung"
    core.on_died("guard#1", 7 * SECOND)
    assert core.state().guard == "absent"


def test_cleared_death_forgets_application_and_its_resources() -> None:
    core = monitor()
    present(core, POSE)
    beat(core, 1, 0)
    core.on_died("hal#1", SECOND)
    assert [check for check, *_ in told(core)] == ["app/hal"]
    assert [age.path for age in core.ages()] == ["nav/pose"], "still expected"
    assert [fault.check for fault in cleared(core, "app/*", 2 * SECOND)] == ["app/hal"]
    assert core.apps.get("hal#1") is None
    assert list(core.ages()) == []


def test_application_without_beat_is_forgotten_at_death() -> None:
    core = monitor()
    present(core, POSE)
    core.on_died("hal#1", SECOND)
    assert core.apps.get("hal#1") is None
    core.on_left("hal#1", 2 * SECOND)
    assert told(core) == []
