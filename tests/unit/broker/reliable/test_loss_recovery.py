"""Packets in flight: arrived, lost by number, lost by time, probed."""

from swarmd.broker.core.frames.reliable.loss_recovery import (
    BACKOFF_MAX,
    COMMAND_PROBES,
    COMMAND_SLACK_NS,
    PACKET_THRESHOLD,
    SLACK_NS,
    LossRecovery,
    SentPacket,
)
from swarmd.broker.core.frames.reliable.packet import Acknowledgement
from swarmd.broker.core.frames.reliable.received_packets import ACK_DELAY_NS

MS = 1_000_000
RTT = 20 * MS


def sent(recovery: LossRecovery, *numbers: int, at_ns: int = 0) -> None:
    for number in numbers:
        recovery.on_sent(SentPacket(number, 1000, at_ns, ()))


def acknowledge(
    recovery: LossRecovery, *ranges: tuple[int, int], now_ns: int, delay_ns: int = 0
) -> tuple[list[int], list[int]]:
    settled = recovery.on_acknowledgement(Acknowledgement(ranges, delay_ns), now_ns)
    return [packet.number for packet in settled.arrived], [packet.number for packet in settled.lost]


def test_a_packet_overtaken_by_three_others_is_lost() -> None:
    recovery = LossRecovery(0)
    sent(recovery, 0, 1, 2, 3)
    assert acknowledge(recovery, (1, PACKET_THRESHOLD - 1), now_ns=RTT) == ([1, 2], [])
    assert acknowledge(recovery, (3, 3), now_ns=RTT) == ([3], [0])
    assert not recovery


def test_overtaken_packet_is_lost_after_nine_eighths() -> None:
    recovery = LossRecovery(0)
    sent(recovery, 0, 1)
    assert acknowledge(recovery, (1, 1), now_ns=RTT) == ([1], [])
    due_ns = recovery.deadline_ns()
    assert due_ns == RTT * 9 // 8
    assert recovery.on_due(due_ns - 1) == ((), False)
    lost, probe = recovery.on_due(due_ns)
    assert [packet.number for packet in lost] == [0]
    assert not probe


def test_acknowledgement_delay_is_excluded_from_round_trip() -> None:
    recovery = LossRecovery(0)
    sent(recovery, 0)
    settled = recovery.on_acknowledgement(Acknowledgement(((0, 0),), 4 * MS), RTT + 4 * MS)
    assert settled.round_trip_ns == RTT
    assert recovery.smoothed_ns == RTT
    sent(recovery, 1, at_ns=RTT)
    settled = recovery.on_acknowledgement(Acknowledgement(((1, 1),), 900 * MS), 2 * RTT)
    assert settled.round_trip_ns == 1, "a neighbour cannot state a longer delay than the whole time"


def test_processor_delay_counts_for_timeouts_only() -> None:
    recovery = LossRecovery(0)
    sent(recovery, 0)
    waited_there_ns, waited_here_ns = 60 * MS, 80 * MS
    arrived_ns = RTT + waited_there_ns
    acknowledgement = Acknowledgement(((0, 0),), waited_there_ns)
    settled = recovery.on_acknowledgement(acknowledgement, arrived_ns + waited_here_ns, arrived_ns)
    assert settled.round_trip_ns == RTT
    assert recovery.smoothed_ns == RTT + waited_there_ns + waited_here_ns - ACK_DELAY_NS


def test_late_packet_lengthens_next_timeouts() -> None:
    recovery = LossRecovery(0)
    sent(recovery, 0, 1, 2, 3)
    acknowledge(recovery, (1, 3), now_ns=RTT)
    settled = recovery.on_acknowledgement(Acknowledgement(((0, 3),), 0), RTT)
    assert (settled.late, settled.arrived) == (1, ())
    sent(recovery, 4, 5, 6, 7, at_ns=RTT)
    assert acknowledge(recovery, (5, 7), now_ns=2 * RTT) == ([5, 6, 7], [])


def test_silence_is_probed_with_growing_intervals() -> None:
    recovery = LossRecovery(0)
    sent(recovery, 0)
    acknowledge(recovery, (0, 0), now_ns=RTT)
    sent(recovery, 1, at_ns=RTT)
    waits: list[int] = []
    now_ns = RTT
    for _ in range(BACKOFF_MAX + 3):
        due_ns = recovery.deadline_ns()
        assert due_ns is not None
        waits.append(due_ns - now_ns)
        now_ns = due_ns
        assert recovery.on_due(now_ns) == ((), True)
        sent(recovery, 10 + len(waits), at_ns=now_ns)
    first = RTT + 4 * (RTT // 2) + SLACK_NS
    assert waits == [first] + [2 * first] * (BACKOFF_MAX + 2)
    acknowledge(recovery, (11, 11), now_ns=now_ns)
    assert recovery.probes == 0


def command(recovery: LossRecovery, number: int, at_ns: int) -> None:
    recovery.on_sent(SentPacket(number, 100, at_ns, (), has_command=True))


def test_command_is_probed_earlier_and_more_often() -> None:
    recovery = LossRecovery(0)
    sent(recovery, 0)
    acknowledge(recovery, (0, 0), now_ns=RTT)
    sent(recovery, 1, at_ns=RTT)
    command(recovery, 2, RTT)
    waits: list[int] = []
    now_ns = RTT
    for number in range(3, COMMAND_PROBES + 6):
        oldest, due_ns = recovery.oldest, recovery.deadline_ns()
        assert oldest is not None
        assert oldest.number == 2, "the command is repeated, not what waits longer"
        assert due_ns is not None
        waits.append(due_ns - now_ns)
        now_ns = due_ns
        assert recovery.on_due(now_ns) == ((), True)
        command(recovery, number, now_ns)
    first = 3 * RTT + COMMAND_SLACK_NS
    assert waits == [first] * (COMMAND_PROBES + 1) + [2 * first] * 2


def test_probe_without_command_data_is_not_due_again() -> None:
    recovery = LossRecovery(RTT)
    command(recovery, 0, 0)
    now_ns = recovery.deadline_ns() or 0
    recovery.on_due(now_ns)
    sent(recovery, 1, at_ns=now_ns)
    due_ns = recovery.deadline_ns()
    assert due_ns is not None
    assert due_ns > now_ns


def test_longer_wait_applies_again_without_command() -> None:
    recovery = LossRecovery(RTT)
    command(recovery, 0, 0)
    sent(recovery, 1)
    acknowledge(recovery, (0, 0), now_ns=RTT)
    sent(recovery, 2, at_ns=RTT)
    recovery.on_due(RTT * 9 // 8)
    assert recovery.deadline_ns() == RTT + 3 * RTT + SLACK_NS


def test_round_trip_of_beacons_counts_at_first() -> None:
    recovery = LossRecovery(RTT)
    sent(recovery, 0)
    assert recovery.deadline_ns() == 2 * RTT + SLACK_NS
    assert LossRecovery(0).deadline_ns() is None


def test_acknowledgement_costs_no_more_than_flight_size() -> None:
    recovery = LossRecovery(0)
    sent(recovery, 5, 7)
    assert acknowledge(recovery, (0, 4_000_000_000), now_ns=RTT) == ([5, 7], [])


def test_what_is_given_up_is_forgotten() -> None:
    recovery = LossRecovery(0)
    sent(recovery, 0, 1, 2)
    recovery.on_due(10**12)
    recovery.clear()
    assert not recovery
    assert recovery.deadline_ns() is None
    assert acknowledge(recovery, (0, 2), now_ns=RTT) == ([], [])
