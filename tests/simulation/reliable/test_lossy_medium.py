"""Reliable links over media as they are in the field: lossy, jittery, slow, changing, cut."""

from typing import Final

import pytest
from tests.simulation.reliable.radio_link import MS, Medium, Pair, S, latencies_ms
from tests.simulation.seeds import seeds

from swarmware.model.frame import Frame, FrameKind

LASTS_S: Final = 12
STREAM_HZ: Final = 30
ITEM_BYTES: Final = 1000


def share(sorted_ms: list[float], ratio: float) -> float:
    return sorted_ms[int(ratio * len(sorted_ms))]


def of_kind(pair: Pair, kind: FrameKind) -> list[tuple[int, Frame]]:
    return [one for one in pair.received[2] if one[1].kind is kind]


def both(seed: int, loss: float, **medium: float) -> tuple[Medium, Medium]:
    """The two directions of a medium."""
    return Medium(seed, loss=loss, **medium), Medium(1000 + seed, loss=loss, **medium)


@pytest.mark.parametrize("seed", seeds(1, 10))
@pytest.mark.parametrize(("loss", "p99_ms"), [(0.0, 40), (0.1, 250), (0.2, 400), (0.3, 600), (0.4, 1000)])
@pytest.mark.parametrize("jitter_ms", [0.0, 8.0])
def test_a_stream_and_commands_arrive_whole_and_once(
    seed: int, loss: float, p99_ms: float, jitter_ms: float
) -> None:
    pair = Pair(*both(seed, loss, jitter_ms=jitter_ms), loss=loss)
    end_ns = pair.now_ns + LASTS_S * S
    pair.every(S // STREAM_HZ, end_ns, lambda: pair.send(ITEM_BYTES))
    pair.every(S // 5, end_ns, lambda: pair.send(100, FrameKind.MESSAGE))
    pair.run(end_ns + 6 * S)
    numbers = [frame.sequence for _, frame in pair.received[2]]
    assert len(numbers) == len(set(numbers)) == pair.sent
    assert pair.dropped == []
    assert share(latencies_ms(of_kind(pair, FrameKind.STREAM)), 0.99) < p99_ms
    assert share(latencies_ms(of_kind(pair, FrameKind.MESSAGE)), 0.99) < p99_ms
    useful = sum(len(frame.payload) for _, frame in pair.received[2])
    assert pair.end(1).repeated_bytes <= 1.5 * loss / (1 - loss) * useful + 20 * ITEM_BYTES


@pytest.mark.parametrize("seed", seeds(1, 5))
@pytest.mark.parametrize("stalled", [0.1, 0.5, 1.0])
def test_stream_keeps_its_rate_although_both_processors_stall(seed: int, stalled: float) -> None:
    media = both(seed, 0.4, delay_ms=1.0)
    pair = Pair(*media, loss=0.4, stall_ms=(5.0, 100.0), stalled=stalled)
    end_ns = pair.now_ns + LASTS_S * S
    pair.every(S // STREAM_HZ, end_ns - 1, lambda: pair.send(ITEM_BYTES))
    pair.every(S // 5, end_ns - 1, lambda: pair.send(200, FrameKind.MESSAGE))
    pair.run(end_ns)
    assert len(of_kind(pair, FrameKind.STREAM)) >= 0.95 * STREAM_HZ * LASTS_S
    pair.run(end_ns + 6 * S)
    assert pair.dropped == []
    assert len(pair.received[2]) == pair.sent
    assert latencies_ms(of_kind(pair, FrameKind.MESSAGE))[-1] < 2000, "none expires"


@pytest.mark.parametrize("seed", seeds(1, 5))
def test_commands_survive_ten_times_overload_of_slow_link(seed: int) -> None:
    pair = Pair(*both(seed, 0.0, rate_bit_s=1e6, queue_bytes=32_000))
    end_ns = pair.now_ns + LASTS_S * S
    pair.every(S // 1250, end_ns, lambda: pair.send(ITEM_BYTES))
    pair.every(S // 5, end_ns, lambda: pair.send(200, FrameKind.MESSAGE))
    pair.run(end_ns + S)
    commands = latencies_ms(of_kind(pair, FrameKind.MESSAGE))
    assert len(commands) == 5 * LASTS_S + 1
    assert share(commands, 0.99) < 200
    items = of_kind(pair, FrameKind.STREAM)
    assert len(items) * ITEM_BYTES * 8 > 0.8e6 * LASTS_S, "the link is used"
    assert pair.dropped, "what does not fit is told"


@pytest.mark.parametrize(
    ("loss", "delay_ms", "fall_ms"), [(0.0, 2.0, 200), (0.0, 5.0, 200), (0.1, 10.0, 350)]
)
@pytest.mark.parametrize("seed", seeds(1, 5))
def test_queue_stays_short_while_rate_of_link_falls(
    seed: int, loss: float, delay_ms: float, fall_ms: float
) -> None:
    there, back = both(seed, loss, rate_bit_s=5e6, delay_ms=delay_ms)
    pair = Pair(there, back, loss=loss)

    def offer() -> None:
        while not pair.sent or len(pair.end(1)) < 200:
            pair.send(ITEM_BYTES)

    measured: list[float] = []
    """Capacity of the link at the end of each rate, as share of what it lets through."""

    def rate(bit_s: float) -> None:
        carried = there.rate_bit_s * (1 - loss) / 8
        measured.append((pair.end(1).rate.capacity_bytes_s or 0.0) / carried)
        there.rate_bit_s = bit_s

    start_ns = pair.now_ns
    pair.every(10 * MS, start_ns + 24 * S, offer)
    pair.at(start_ns + 8 * S, lambda: rate(0.5e6))
    pair.at(start_ns + 16 * S, lambda: rate(5e6))
    pair.run(start_ns + 24 * S)
    rate(5e6)
    assert measured == pytest.approx([1.0, 1.0, 1.0], abs=0.2), "the capacity is known"

    def passed(first_s: int, last_s: int) -> float:
        """Share of the rate that carried items."""
        count = sum(first_s * S <= at_ns - start_ns < last_s * S for at_ns, _ in pair.received[2])
        bit_s = 0.5e6 if first_s >= 8 and last_s <= 16 else 5e6
        return count * ITEM_BYTES * 8 / (last_s - first_s) / bit_s / (1 - loss)

    def queueing_ms(first_s: int, last_s: int) -> list[float]:
        return sorted(
            wait_ns / MS for at_ns, wait_ns in there.queueing if first_s * S <= at_ns - start_ns < last_s * S
        )

    for first_s, last_s in ((3, 8), (10, 16), (19, 24)):
        assert queueing_ms(first_s, last_s)[-1] < 150
        assert passed(first_s, last_s) > 0.75
    assert queueing_ms(8, 10)[-1] < fall_ms, "what was in flight needs ten times the round trip"


@pytest.mark.parametrize(("loss", "rate_bit_s"), [(0.0, 50e6), (0.2, 50e6), (0.3, 5e6)])
@pytest.mark.parametrize("seed", seeds(1, 5))
def test_bulk_uses_the_link_and_repeats_little(seed: int, loss: float, rate_bit_s: float) -> None:
    pair = Pair(*both(seed, loss, rate_bit_s=rate_bit_s), loss=loss)
    start_ns = pair.now_ns
    for _ in range(250):
        pair.send(4096, FrameKind.FILE)
    pair.run(start_ns + 30 * S)
    assert len(pair.received[2]) == 250
    ideal_s = 250 * 4096 * 8 / rate_bit_s / (1 - loss)
    assert (pair.received[2][-1][0] - start_ns) / S < 1.5 * ideal_s + 1.0
    assert pair.end(1).repeated_bytes < (1.5 * loss / (1 - loss) + 0.15) * 250 * 4096


@pytest.mark.parametrize("seed", seeds(1, 5))
def test_a_message_of_four_megabytes_arrives_whole(seed: int) -> None:
    pair = Pair(*both(seed, 0.1), loss=0.1)
    frame = pair.send(4_000_000, FrameKind.MESSAGE)
    pair.run(pair.now_ns + 30 * S)
    [(_, found)] = pair.received[2]
    assert bytes(found.payload) == bytes(frame.payload)


def test_traffic_recovers_in_fraction_of_second_after_cut() -> None:
    there, back = both(1, 0.0)
    pair = Pair(there, back)
    start_ns = pair.now_ns
    pair.every(S // STREAM_HZ, start_ns + 12 * S, lambda: pair.send(ITEM_BYTES))

    def cut(is_cut: bool) -> None:
        there.is_cut = back.is_cut = is_cut

    pair.at(start_ns + 5 * S, lambda: cut(True))
    pair.at(start_ns + 8 * S, lambda: cut(False))
    pair.run(start_ns + 15 * S)
    again_ns = min(at_ns for at_ns, _ in pair.received[2] if at_ns >= start_ns + 8 * S)
    assert again_ns - start_ns - 8 * S < 0.5 * S
    assert len(pair.received[2]) + len(pair.dropped) == pair.sent


@pytest.mark.parametrize("seed", seeds(1, 5))
def test_both_directions_at_once(seed: int) -> None:
    pair = Pair(*both(seed, 0.2, jitter_ms=5.0), loss=0.2)
    end_ns = pair.now_ns + LASTS_S * S
    pair.every(S // STREAM_HZ, end_ns, lambda: pair.send(ITEM_BYTES, sender=1))
    pair.every(S // STREAM_HZ, end_ns, lambda: pair.send(ITEM_BYTES, sender=2))
    pair.run(end_ns + 5 * S)
    assert len(pair.received[1]) == len(pair.received[2]) == pair.sent // 2
