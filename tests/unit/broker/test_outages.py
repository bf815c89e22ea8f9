"""The record of an outage: from the last datagram to the queue that is empty again."""

import msgspec
import pytest

from swarmd.broker.config import Config
from swarmd.broker.core.reports.outages import (
    DRAIN_MAX_NS,
    LOOK_NS,
    SAVE_NS,
    OutageLog,
    ReadBacklog,
    SaveOutages,
)
from swarmd.broker.core.swarm.links.link import LinkChanged, LinkEvent, LinkState
from swarmware.types.outage import LinkOutage, OutageCause, OutagePhase, OutageTable

S = 1_000_000_000
UTC_NS = 1_700_000_000 * S
HW = 7


def change(
    before: LinkState, after: LinkState, event: LinkEvent = LinkEvent.BEACON, worked_ns: int = 0
) -> LinkChanged:
    return LinkChanged(HW, before, after, event, worked_ns)


LOST = change(LinkState.UP, LinkState.DOWN, LinkEvent.SILENT, 10 * S)
HEARD = change(LinkState.DOWN, LinkState.HEARD)
UP = change(LinkState.HEARD, LinkState.UP, LinkEvent.LISTED)


def feed(log: OutageLog, found: LinkChanged, at_s: float) -> list[object]:
    return list(log.on_link(found, "uav2", "main", round(at_s * S)))


def newest(log: OutageLog, now_s: float = 100.0) -> LinkOutage:
    return log.table(round(now_s * S), UTC_NS + round(now_s * S)).outages[0]


def drain(log: OutageLog, queue: dict[float, int], until_s: float) -> None:
    """Runs the log's deadlines; `queue`: frames that wait, from these instants on."""
    while (due_ns := log.deadline_ns()) is not None and due_ns <= until_s * S:
        for action in log.on_timer(due_ns):
            if action == SaveOutages():
                continue
            assert action == ReadBacklog(HW)
            waiting = [frames for since_s, frames in queue.items() if since_s * S <= due_ns]
            frames = waiting[-1] if waiting else 0
            log.on_backlog(HW, frames, 100 * frames, due_ns)


def test_record_has_four_times_and_backlog() -> None:
    log = OutageLog(Config())
    assert feed(log, LOST, 11.2) == [SaveOutages()]
    assert newest(log, 12).phase is OutagePhase.LOST
    assert log.lost == 1
    feed(log, HEARD, 30.0)
    assert newest(log, 30).phase is OutagePhase.RETURNING
    feed(log, UP, 30.4)
    assert newest(log, 30.4).phase is OutagePhase.DRAINING
    assert log.lost == 0
    drain(log, {30.0: 40, 30.9: 12, 32.05: 0}, 40)
    assert newest(log).drained_in_s == pytest.approx(1.6, abs=1e-6)
    assert newest(log) == LinkOutage(
        "uav2",
        "main",
        HW,
        UTC_NS + 10 * S,
        OutageCause.SILENT,
        OutagePhase.OVER,
        detected_after_s=1.2,
        down_for_s=20.0,
        recovered_in_s=0.4,
        drained_in_s=1.6,
        backlog_frames=40,
        backlog_bytes=4000,
    )
    assert log.deadline_ns() is None, "nothing is read when no link drains"


def test_without_a_backlog_it_is_drained_at_once() -> None:
    log = OutageLog(Config())
    feed(log, LOST, 11)
    feed(log, HEARD, 20)
    feed(log, UP, 20.2)
    drain(log, {}, 30)
    assert (newest(log).drained_in_s, newest(log).backlog_frames) == (0.0, 0)


def test_repeated_frames_after_return_join_backlog() -> None:
    log = OutageLog(Config())
    feed(log, LOST, 11)
    feed(log, HEARD, 20)
    feed(log, UP, 20.2)
    drain(log, {20.5: 3, 20.8: 0}, 30)
    assert newest(log).backlog_frames == 3
    assert newest(log).drained_in_s == pytest.approx(0.5, abs=LOOK_NS / S)


def test_never_empty_queue_ends_record_without_time() -> None:
    log = OutageLog(Config())
    feed(log, LOST, 11)
    feed(log, HEARD, 20)
    feed(log, UP, 20)
    drain(log, {20.0: 5}, 20 + 2 * DRAIN_MAX_NS / S)
    assert newest(log).phase is OutagePhase.OVER
    assert newest(log).drained_in_s is None


def test_link_lost_while_draining_is_another_outage() -> None:
    log = OutageLog(Config())
    feed(log, LOST, 11)
    feed(log, HEARD, 20)
    feed(log, UP, 20)
    drain(log, {20.0: 5}, 21)
    feed(log, change(LinkState.UP, LinkState.DOWN, LinkEvent.SILENT, 21 * S), 22)
    second, first = log.table(30 * S, UTC_NS).outages
    assert (first.phase, first.drained_in_s, first.backlog_frames) == (OutagePhase.OVER, None, 5)
    assert (second.phase, second.down_for_s) == (OutagePhase.LOST, None)


def test_the_first_meeting_is_no_outage() -> None:
    log = OutageLog(Config())
    assert feed(log, HEARD, 1) == []
    assert feed(log, UP, 2) == []
    assert log.table(3 * S, UTC_NS) == OutageTable()
    assert log.deadline_ns() is None


def test_unproven_return_counts_from_last() -> None:
    log = OutageLog(Config())
    feed(log, LOST, 11)
    feed(log, HEARD, 20)
    feed(log, change(LinkState.HEARD, LinkState.DOWN, LinkEvent.SILENT, 20 * S), 22)
    assert (newest(log).phase, newest(log).down_for_s) == (OutagePhase.LOST, None)
    feed(log, HEARD, 30)
    feed(log, UP, 30.5)
    drain(log, {}, 40)
    assert (newest(log).down_for_s, newest(log).recovered_in_s) == (20.0, 0.5)


def test_neighbour_not_receiving_us_is_down() -> None:
    log = OutageLog(Config())
    feed(log, change(LinkState.UP, LinkState.HALF_OPEN, LinkEvent.UNLISTED, 5 * S), 12)
    feed(log, change(LinkState.HALF_OPEN, LinkState.UP, LinkEvent.LISTED), 20)
    found = newest(log)
    assert (found.cause, found.detected_after_s) == (OutageCause.HALF_OPEN, 7.0)
    assert (found.down_for_s, found.recovered_in_s) == (15.0, 0.0)


def test_restarted_neighbour_is_down_until_first_datagram() -> None:
    log = OutageLog(Config())
    feed(log, change(LinkState.UP, LinkState.HEARD, LinkEvent.RESTARTED, 5 * S), 5.6)
    feed(log, UP, 6)
    found = newest(log)
    assert (found.cause, found.detected_after_s, found.down_for_s) == (OutageCause.RESTARTED, 0.6, 0.6)
    assert found.recovered_in_s == 0.4


def test_step_of_wall_clock_does_not_move_beginning() -> None:
    log = OutageLog(Config())
    feed(log, LOST, 11)
    before = log.table(11 * S, UTC_NS + 11 * S).outages[0].began_utc_ns
    assert log.table(12 * S, UTC_NS + 5000 * S).outages[0].began_utc_ns == before == UTC_NS + 10 * S


def test_platform_that_left_swarm_has_no_outage() -> None:
    log = OutageLog(Config())
    feed(log, LOST, 11)
    assert log.on_forgotten(HW, 12 * S) == [SaveOutages()]
    assert log.on_forgotten(HW, 12 * S) == []
    assert log.table(12 * S, UTC_NS) == OutageTable()


def test_former_records_stay_and_open_have_no_length() -> None:
    log = OutageLog(Config())
    feed(log, LOST, 11)
    kept = log.table(12 * S, UTC_NS)
    over = msgspec.structs.replace(kept.outages[0], phase=OutagePhase.OVER, down_for_s=3.0)
    again = OutageLog(Config(), (*kept.outages, over))
    first, second = again.table(S, UTC_NS).outages
    assert (first.phase, first.down_for_s) == (OutagePhase.INTERRUPTED, None)
    assert second == over
    feed(again, LOST, 20)
    assert [one.phase for one in again.table(30 * S, UTC_NS).outages] == ["lost", "interrupted", "over"]


def test_link_that_flaps_for_hours_keeps_newest_records() -> None:
    log = OutageLog(Config(outages=4))
    for number in range(12):
        at_s = 10.0 * number
        feed(log, change(LinkState.UP, LinkState.DOWN, LinkEvent.SILENT, round(at_s * S)), at_s + 1)
        feed(log, HEARD, at_s + 2)
        feed(log, UP, at_s + 3)
    table = log.table(4000 * S, UTC_NS + 4000 * S).outages
    assert len(table) == 4 + 1
    assert [one.began_utc_ns for one in table] == sorted((one.began_utc_ns for one in table), reverse=True)


def test_links_that_fall_together_are_saved_together() -> None:
    log = OutageLog(Config())
    assert feed(log, LOST, 11.0) == [SaveOutages()]
    for hw in range(8, 20):
        lost = LinkChanged(hw, LinkState.UP, LinkState.DOWN, LinkEvent.SILENT, 10 * S)
        assert log.on_link(lost, f"uav{hw}", "main", 11 * S + hw) == []
    assert log.deadline_ns() == 11 * S + SAVE_NS
    assert log.on_timer(11 * S + SAVE_NS - 1) == []
    assert log.on_timer(11 * S + SAVE_NS) == [SaveOutages()]
    assert not log.unsaved
    assert log.deadline_ns() is None
    assert len(log.table(12 * S, UTC_NS).outages) == 13
    assert feed(log, HEARD, 13.0) == [SaveOutages()], "a single one is saved at once"
