"""A driver's schedule: absolute instants, rate and lateness."""

from swarmd.hal.core.schedule import Schedule
from swarmware.types.driver import DriverState

MS = 1_000_000


def test_reads_are_due_at_absolute_instants() -> None:
    schedule = Schedule("gnss", 0.1, 0)
    schedule.opened(0)
    begins = []
    now_ns = 0
    for late_ms in (0, 30, 5, 0, 60):
        now_ns = schedule.due_ns + late_ms * MS
        schedule.begin(now_ns)
        begins.append(now_ns // MS)
    assert begins == [0, 130, 205, 300, 460]
    assert schedule.due_ns == 500 * MS


def test_missed_periods_are_counted_not_made_up() -> None:
    schedule = Schedule("imu", 0.02, 0)
    schedule.opened(0)
    schedule.begin(0)
    schedule.begin(110 * MS)
    status = schedule.report(200 * MS)
    assert status.missed == 4
    assert schedule.due_ns == 120 * MS


def test_devices_opened_apart_are_read_together() -> None:
    for phase_ms in (0, 4):
        for opened_ms in (5, 41, 77):
            schedule = Schedule(f"at {opened_ms}", 0.1, 0, phase_ms * MS)
            schedule.opened(opened_ms * MS)
            assert schedule.due_ns == opened_ms * MS, "the first read is not kept waiting"
            schedule.begin(opened_ms * MS)
            assert schedule.due_ns == (100 + phase_ms) * MS
            schedule.begin(schedule.due_ns)
            assert schedule.due_ns == (200 + phase_ms) * MS


def test_report_has_rate_and_worst_lateness() -> None:
    schedule = Schedule("gnss", 0.1, 0)
    schedule.opened(0)
    for i in range(10):
        schedule.begin(i * 100 * MS + (7 * MS if i == 3 else 0))
        schedule.done()
    first = schedule.report(1000 * MS)
    assert (first.asked_hz, first.real_hz, first.worst_late_ms, first.reads) == (10.0, 10.0, 7.0, 10)
    second = schedule.report(2000 * MS)
    assert (second.real_hz, second.worst_late_ms, second.reads) == (0.0, 0.0, 10)


def test_failures_are_counted_until_successful_read() -> None:
    schedule = Schedule("gps", 0.1, 0)
    schedule.opened(0)
    assert [schedule.failed("no answer") for _ in range(3)] == [1, 2, 3]
    schedule.done()
    assert schedule.failed("no answer") == 1
    assert schedule.report(MS).errors == 4


def test_the_state_is_that_of_the_device() -> None:
    schedule = Schedule("gps", 0.1, 0)
    assert schedule.report(MS).state == "waiting"
    schedule.opened(MS)
    assert schedule.report(2 * MS).state == "running"
    schedule.closed(DriverState.FAILED, "unplugged")
    status = schedule.report(3 * MS)
    assert (status.state, status.note) == ("failed", "unplugged")


def test_changed_period_begins_at_next_of_its_instants() -> None:
    for phase_ms in (0, 4):
        schedule = Schedule("imu", 0.05, 0, phase_ms * MS)
        schedule.opened(phase_ms * MS)
        schedule.begin(phase_ms * MS)
        schedule.begin((150 + phase_ms) * MS)
        schedule.retime(0.1)
        assert schedule.due_ns == (200 + phase_ms) * MS
        schedule.begin(schedule.due_ns)
        assert schedule.due_ns == (300 + phase_ms) * MS
        schedule.retime(0.05)
        assert schedule.due_ns == (250 + phase_ms) * MS
        schedule.retime(0.05)
        assert schedule.due_ns == (250 + phase_ms) * MS
        assert schedule.report(300 * MS).asked_hz == 20.0


def test_passing_fail_safe_warns_and_lasting_errs() -> None:
    schedule = Schedule("sim.chassis", 0.05, 0, actuator=True)
    schedule.opened(0)
    assert schedule.safe("", 0) is None
    assert schedule.safe("no set-point", 500 * MS) == "warn"
    assert schedule.safe("no set-point", 3400 * MS) is None, "what has not changed is not reported again"
    assert schedule.report(3400 * MS).state == "failsafe"
    assert schedule.safe("no set-point", 3500 * MS) == "error"
    assert schedule.safe("", 3600 * MS) == "ok"
    assert schedule.report(3600 * MS).state == "running"
    assert schedule.safe("no set-point", 9000 * MS) == "warn", "its time begins again"


def test_fail_safe_ends_with_reopened_device() -> None:
    schedule = Schedule("sim.chassis", 0.05, 0, actuator=True)
    schedule.opened(0)
    schedule.safe("no set-point", 0)
    schedule.closed(DriverState.WAITING, "unplugged")
    schedule.opened(1000 * MS)
    assert schedule.safe("", 1000 * MS) == "ok", "otherwise the fault would stay"
