"""Packets in flight: arrived, lost by number, lost by time, probed."""

from swarmware.transport.retransmission.loss_detection import LossDetection, SentPacket
from swarmware.transport.retransmission.policy import RetransmissionPolicy

MS = 1_000_000
RTT = 20 * MS
POLICY = RetransmissionPolicy(
    initial_ns=200 * MS,
    granularity_ns=MS,
    ack_delay_ns=4 * MS,
    slack_ns=15 * MS,
    urgent_slack_ns=5 * MS,
    urgent_probes=3,
    doublings_max=1,
)

Detection = LossDetection[SentPacket]


def sent(detection: Detection, *numbers: int, at_ns: int = 0) -> None:
    for number in numbers:
        detection.on_sent(SentPacket(number, False, sent_ns=at_ns, size=1000))


def acknowledge(
    detection: Detection, *ranges: tuple[int, int], now_ns: int, delay_ns: int = 0
) -> tuple[list[int], list[int]]:
    settled = detection.on_acknowledgement(ranges, delay_ns, now_ns)
    return [packet.number for packet in settled.arrived], [packet.number for packet in settled.lost]


def test_a_packet_overtaken_by_three_others_is_lost() -> None:
    detection = Detection(POLICY, 0)
    sent(detection, 0, 1, 2, 3)
    assert acknowledge(detection, (1, POLICY.packet_threshold - 1), now_ns=RTT) == ([1, 2], [])
    assert acknowledge(detection, (3, 3), now_ns=RTT) == ([3], [0])
    assert not detection


def test_overtaken_packet_is_lost_after_nine_eighths() -> None:
    detection = Detection(POLICY, 0)
    sent(detection, 0, 1)
    assert acknowledge(detection, (1, 1), now_ns=RTT) == ([1], [])
    due_ns = detection.deadline_ns()
    assert due_ns == RTT * 9 // 8
    assert detection.on_due(due_ns - 1) == ([], False)
    lost, probe = detection.on_due(due_ns)
    assert [packet.number for packet in lost] == [0]
    assert not probe


def test_acknowledgement_delay_is_excluded_from_round_trip() -> None:
    detection = Detection(POLICY, 0)
    sent(detection, 0)
    settled = detection.on_acknowledgement(((0, 0),), 4 * MS, RTT + 4 * MS)
    assert settled.round_trip_ns == RTT
    assert detection.smoothed_ns == RTT
    sent(detection, 1, at_ns=RTT)
    settled = detection.on_acknowledgement(((1, 1),), 900 * MS, 2 * RTT)
    assert settled.round_trip_ns == 1, "a neighbour cannot state a longer delay than the whole time"


def test_processor_delay_counts_for_timeouts_only() -> None:
    detection = Detection(POLICY, 0)
    sent(detection, 0)
    waited_there_ns, waited_here_ns = 60 * MS, 80 * MS
    arrived_ns = RTT + waited_there_ns
    settled = detection.on_acknowledgement(
        ((0, 0),), waited_there_ns, arrived_ns + waited_here_ns, arrived_ns
    )
    assert settled.round_trip_ns == RTT
    assert detection.smoothed_ns == RTT + waited_there_ns + waited_here_ns - POLICY.ack_delay_ns


def test_late_packet_lengthens_next_timeouts() -> None:
    detection = Detection(POLICY, 0)
    sent(detection, 0, 1, 2, 3)
    acknowledge(detection, (1, 3), now_ns=RTT)
    settled = detection.on_acknowledgement(((0, 3),), 0, RTT)
    assert (settled.late, settled.arrived) == (1, [])
    sent(detection, 4, 5, 6, 7, at_ns=RTT)
    assert acknowledge(detection, (5, 7), now_ns=2 * RTT) == ([5, 6, 7], [])


def test_silence_is_probed_with_growing_intervals() -> None:
    detection = Detection(POLICY, 0)
    sent(detection, 0)
    acknowledge(detection, (0, 0), now_ns=RTT)
    sent(detection, 1, at_ns=RTT)
    waits: list[int] = []
    now_ns = RTT
    for _ in range(POLICY.doublings_max + 3):
        due_ns = detection.deadline_ns()
        assert due_ns is not None
        waits.append(due_ns - now_ns)
        now_ns = due_ns
        assert detection.on_due(now_ns) == ([], True)
        sent(detection, 10 + len(waits), at_ns=now_ns)
    first = RTT + 4 * (RTT // 2) + POLICY.slack_ns
    assert waits == [first] + [2 * first] * (POLICY.doublings_max + 2)
    acknowledge(detection, (11, 11), now_ns=now_ns)
    assert detection.failures == 0


def command(detection: Detection, number: int, at_ns: int) -> None:
    detection.on_sent(SentPacket(number, True, sent_ns=at_ns, size=100))


def test_command_is_probed_earlier_and_more_often() -> None:
    detection = Detection(POLICY, 0)
    sent(detection, 0)
    acknowledge(detection, (0, 0), now_ns=RTT)
    sent(detection, 1, at_ns=RTT)
    command(detection, 2, RTT)
    waits: list[int] = []
    now_ns = RTT
    for number in range(3, POLICY.urgent_probes + 6):
        oldest, due_ns = detection.to_probe, detection.deadline_ns()
        assert oldest is not None
        assert oldest.number == 2, "the command is repeated, not what waits longer"
        assert due_ns is not None
        waits.append(due_ns - now_ns)
        now_ns = due_ns
        assert detection.on_due(now_ns) == ([], True)
        command(detection, number, now_ns)
    first = 3 * RTT + POLICY.urgent_slack_ns
    assert waits == [first] * (POLICY.urgent_probes + 1) + [2 * first] * 2


def test_probe_without_command_data_is_not_due_again() -> None:
    detection = Detection(POLICY, RTT)
    command(detection, 0, 0)
    now_ns = detection.deadline_ns() or 0
    detection.on_due(now_ns)
    sent(detection, 1, at_ns=now_ns)
    due_ns = detection.deadline_ns()
    assert due_ns is not None
    assert due_ns > now_ns


def test_longer_wait_applies_again_without_command() -> None:
    detection = Detection(POLICY, RTT)
    command(detection, 0, 0)
    sent(detection, 1)
    acknowledge(detection, (0, 0), now_ns=RTT)
    sent(detection, 2, at_ns=RTT)
    detection.on_due(RTT * 9 // 8)
    assert detection.deadline_ns() == RTT + 3 * RTT + POLICY.slack_ns


def test_round_trip_of_beacons_counts_at_first() -> None:
    detection = Detection(POLICY, RTT)
    sent(detection, 0)
    assert detection.deadline_ns() == 2 * RTT + POLICY.slack_ns
    assert Detection(POLICY, 0).deadline_ns() is None


def test_acknowledgement_costs_no_more_than_flight_size() -> None:
    detection = Detection(POLICY, 0)
    sent(detection, 5, 7)
    assert acknowledge(detection, (0, 4_000_000_000), now_ns=RTT) == ([5, 7], [])


def test_what_is_given_up_is_forgotten() -> None:
    detection = Detection(POLICY, 0)
    sent(detection, 0, 1, 2)
    detection.on_due(10**12)
    detection.clear()
    assert not detection
    assert detection.deadline_ns() is None
    assert acknowledge(detection, (0, 2), now_ns=RTT) == ([], [])
