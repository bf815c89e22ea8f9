"""Video over links as they are in the field: slow at once, lossy, without reports, cut."""

import pytest
from tests.simulation.reliable.radio_link import Medium, S
from tests.simulation.video.session import SimulatedSession, share

MBIT = 1e6


def session(
    seed: int, *, rate_bit_s: float = 5 * MBIT, loss: float = 0.0, delay_ms: float = 10.0, **rest: bool
) -> SimulatedSession:
    there = Medium(seed, rate_bit_s=rate_bit_s, loss=loss, delay_ms=delay_ms)
    return SimulatedSession(there, Medium(seed + 100, rate_bit_s=rate_bit_s, loss=loss), seed=seed, **rest)


@pytest.mark.parametrize(("seed", "delay_ms"), [(1, 10.0), (2, 10.0), (3, 2.0)])
def test_queue_stays_below_200_ms_on_failing_link(seed: int, delay_ms: float) -> None:
    made = session(seed, delay_ms=delay_ms)
    made.change(10, 0.5 * MBIT)
    made.change(25, 5 * MBIT)
    made.run(45)
    assert made.queueing_ms(0, 10)[-1] < 100
    # what is on its way when the link falls needs ten times as long
    assert made.queueing_ms(10, 12)[-1] < 200
    assert made.queueing_ms(11.5, 25)[-1] < 200
    assert made.queueing_ms(25, 45)[-1] < 100
    # it uses the link before, during and after, as far as the guard of the queue permits
    assert made.mean_bit_s(8, 10) > (3.5 if delay_ms < 10 else 2.0) * MBIT
    assert 0.3 * MBIT < made.mean_bit_s(14, 25) < 0.5 * MBIT
    assert made.mean_bit_s(38, 45) > (3.5 if delay_ms < 10 else 2.0) * MBIT
    assert len(made.shown) > 40 * 25
    ages_ms = sorted(one.age_ns / 1e6 for one in made.shown)
    assert share(ages_ms, 0.95) < 200
    reasons = [one.reason for one in made.sender.bitrate.changes]
    assert "free" in reasons
    assert any(reason.startswith("queue of") for reason in reasons)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("loss", [0.01, 0.05])
def test_reported_loss_is_repaired_by_key_frame(loss: float, seed: int) -> None:
    made = session(seed, loss=loss)
    made.run(20)
    counters = made.receiver.counters
    assert counters.lost == pytest.approx(loss * made.sender.counters.packets, rel=0.5)
    assert counters.gaps > 0
    assert made.sender.counters.key_frames_asked > 0
    # each shown picture has all that it needs: its number says that none is shown twice or out of order
    shown = [one.index for one in made.shown]
    assert shown == sorted(set(shown))
    assert len(shown) + counters.dropped >= 0.9 * made.sender.counters.pictures
    # loss of the link itself is no congestion
    assert made.mean_bit_s(10, 20) > 0.5 * MBIT


def test_pinned_rate_stays_and_excess_is_skipped() -> None:
    made = session(1, rate_bit_s=0.5 * MBIT, pinned=True)
    made.run(10)
    assert made.mean_bit_s(0, 10) == 4 * MBIT
    assert made.sender.counters.skipped > 100
    assert made.queueing_ms(3, 10)[-1] < 200, "the window holds also then"


def test_standard_receiver_gets_rate_by_loss() -> None:
    made = session(1, rate_bit_s=0.8 * MBIT, reports_arrivals=False)
    made.run(30)
    assert 0.3 * MBIT < made.mean_bit_s(15, 30) < 0.9 * MBIT
    assert share(made.queueing_ms(15, 30), 0.95) < 500


def test_video_continues_with_key_frame_after_cut() -> None:
    made = session(1)
    made.time.at(S + 10 * S, lambda: setattr(made.there, "is_cut", True))
    made.time.at(S + 16 * S, lambda: setattr(made.there, "is_cut", False))
    made.run(25)
    during = [one for one in made.shown if 11 * S < one.at_ns < 17 * S]
    after = [one for one in made.shown if one.at_ns >= 17 * S]
    assert len(during) < 5
    assert after[0].at_ns < 19 * S
    assert len(after) > 100
    assert any(one.reason == "no reports" for one in made.sender.bitrate.changes)
