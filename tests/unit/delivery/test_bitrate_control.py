"""The rate of an encoder: down with a queue, up when the link is free, still when it is pinned."""

import pytest

from swarmware.transport.delivery.bitrate_control import (
    BEGIN_BIT_S,
    QUEUE_NS,
    RATE_MIN,
    STEP_NS,
    BitrateControl,
)

MS = 1_000_000


def fed(control: BitrateControl, begin_ns: int, bit_s: int, span_ns: int = 600 * MS) -> int:
    """Bytes arrive at a rate for a while; the instant afterwards."""
    for at_ns in range(begin_ns, begin_ns + span_ns, 10 * MS):
        control.on_received(bit_s // 800, at_ns)
    return begin_ns + span_ns


def test_bitrate_begins_low_and_respects_limit() -> None:
    assert BitrateControl(4_000_000, False, 0).bit_s == BEGIN_BIT_S
    assert BitrateControl(300_000, False, 0).bit_s == 300_000
    assert BitrateControl(4_000_000, True, 0).bit_s == 4_000_000


@pytest.mark.parametrize(("queueing_ns", "waiting_ns"), [(QUEUE_NS + MS, 0), (0, QUEUE_NS + MS)])
def test_queue_lowers_rate_below_arrivals(queueing_ns: int, waiting_ns: int) -> None:
    control = BitrateControl(4_000_000, False, 0)
    now_ns = fed(control, 0, 500_000)
    control.on_queue(queueing_ns, waiting_ns, now_ns)
    assert 380_000 < control.bit_s < 450_000
    assert control.changes[-1].reason == "queue of 61 ms"
    lowered = control.bit_s
    control.on_queue(queueing_ns, waiting_ns, now_ns + STEP_NS - 1)
    assert control.bit_s == lowered, "the same queue does not count twice"


def test_free_link_raises_rate_stepwise_to_limit() -> None:
    control = BitrateControl(1_300_000, False, 0)
    now_ns, rates = 0, []
    for _ in range(6):
        now_ns = fed(control, now_ns, 1_500_000)
        control.on_queue(0, 0, now_ns)
        rates.append(control.bit_s)
    assert rates == sorted(rates)
    assert rates[0] == round(BEGIN_BIT_S * 1.08)
    assert rates[-1] == 1_300_000
    assert [one.reason for one in control.changes] == ["begin", "free"], "a rise is one line"


def test_quiet_picture_raises_no_untried_rate() -> None:
    control = BitrateControl(4_000_000, False, 0)
    now_ns = fed(control, 0, 100_000)
    for _ in range(5):
        now_ns = fed(control, now_ns, 100_000)
        control.on_queue(0, 0, now_ns)
    assert control.bit_s == BEGIN_BIT_S


@pytest.mark.parametrize(
    ("lost_ratio", "round_trips_ms", "expected"),
    [
        (0.3, (20, 20), 850_000),
        (0.05, (20, 20), 1_000_000),
        (0.0, (20, 20), 1_080_000),
        (0.0, (20, 120), 850_000),
        (0.0, (None, None), 1_080_000),
    ],
)
def test_receiver_reporting_only_loss_is_followed(
    lost_ratio: float, round_trips_ms: tuple[int | None, int | None], expected: int
) -> None:
    control = BitrateControl(4_000_000, False, 0)
    first, second = (None if one is None else one * MS for one in round_trips_ms)
    control.on_report(lost_ratio, first, 0)
    control.on_report(lost_ratio, second, STEP_NS)
    assert control.bit_s == expected


def test_silence_halves_the_rate_down_to_the_least() -> None:
    control = BitrateControl(4_000_000, False, 0)
    for second in range(9):
        control.on_silence(second * 1_000 * MS)
    assert control.bit_s == RATE_MIN
    assert control.changes[-1].reason == "no reports"


def test_a_pinned_rate_stays_until_it_is_released() -> None:
    control = BitrateControl(4_000_000, False, 0)
    control.pin(700_000, True, 0)
    now_ns = fed(control, 0, 100_000)
    control.on_queue(500 * MS, 0, now_ns)
    control.on_report(0.5, 500 * MS, now_ns)
    control.on_silence(now_ns)
    assert (control.bit_s, control.pinned) == (700_000, True)
    control.pin(2_000_000, False, now_ns)
    assert control.bit_s == 700_000
    control.on_queue(500 * MS, 0, now_ns + STEP_NS)
    assert control.bit_s < 100_000
    assert [one.reason for one in control.changes][:2] == ["begin", "pinned"]
