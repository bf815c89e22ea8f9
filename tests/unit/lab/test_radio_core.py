"""The core of the radio, in virtual time: what arrives, when, and what is counted."""

import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.unit.lab.radio_rig import MS, PLAIN, SECOND, RadioRig

from swarmlab.radio.core.link import SHAPER_BYTES, ImpairmentChange
from swarmlab.radio.core.model import CurvePoint, RadioModel

CURVE = (
    CurvePoint(distance_m=0, rate_bit_s=8e6, loss_ratio=0.0),
    CurvePoint(distance_m=100, rate_bit_s=8e6, loss_ratio=0.5),
)


def radio(**changes: Any) -> RadioModel:
    """8 Mbit/s to all, so that a kilobyte takes a millisecond; to 100 m."""
    return RadioModel(
        **{"description": "test", "multicast_rate_bit_s": 8e6, "ground": CURVE, "air": CURVE, **changes}
    )


def test_unicast_reaches_receiver_and_broadcast_all_others() -> None:
    rig = RadioRig()
    rig.send("gcs", "uav1", 0)
    rig.send("ugv1", None, SECOND)
    rig.until(2 * SECOND)
    assert rig.receivers() == ["uav1", "gcs", "uav1"]
    assert [at_ns for at_ns, _ in rig.arrived] == [8000, SECOND + 8000, SECOND + 8000]


@pytest.mark.parametrize("data", [b"", b"\x02", bytes(60), b"\x02SW\x00\x77\x77" + bytes(60)])
def test_a_frame_to_an_unknown_address_arrives_nowhere(data: bytes) -> None:
    rig = RadioRig()
    assert rig.core.on_frame(0, data, 0) == []
    assert rig.core.deadline_ns() is None


def test_a_frame_to_its_sender_arrives_nowhere() -> None:
    rig = RadioRig()
    rig.send("gcs", "gcs", 0)
    assert rig.core.deadline_ns() is None


def test_frame_takes_its_airtime_then_delay_of_radio() -> None:
    rig = RadioRig(radio(overhead_s=0.002, delay_s=0.003))
    rig.send("gcs", "ugv1", 0)
    rig.until(SECOND)
    assert rig.arrived[0][0] == (2 + 1 + 3) * MS
    assert rig.report("gcs", "ugv1").delay_s == pytest.approx(0.006)


def test_nodes_in_range_transmit_in_turn() -> None:
    rig = RadioRig(radio())
    rig.send("gcs", "ugv1", 0)
    rig.send("uav1", "gcs", 100)
    rig.send("ugv1", "gcs", 200)
    rig.until(SECOND)
    assert [(rig.names[got.receiver], at_ns) for at_ns, got in rig.arrived] == [
        ("ugv1", 1 * MS),
        ("gcs", 2 * MS),
        ("gcs", 3 * MS),
    ]


def test_nodes_out_of_range_transmit_simultaneously() -> None:
    rig = RadioRig(radio(), names=("gcs", "ugv1", "uav1", "uav2"))
    rig.place(uav1=(5000, 0, 0), uav2=(5010, 0, 0))
    rig.send("gcs", "ugv1", 0)
    rig.send("uav1", "uav2", 0)
    rig.until(SECOND)
    assert [at_ns for at_ns, _ in rig.arrived] == [MS, MS]


def test_without_shared_air_each_node_transmits_for_itself() -> None:
    rig = RadioRig(radio(shared_air=False))
    rig.send("gcs", "ugv1", 0)
    rig.send("uav1", "ugv1", 0)
    rig.until(SECOND)
    assert [at_ns for at_ns, _ in rig.arrived] == [MS, MS]


def test_full_transmit_queue_drops_and_counts() -> None:
    rig = RadioRig(radio(queue_bytes=2000))
    for _ in range(4):
        rig.send("gcs", "ugv1", 0)  # the first is in the air at once, two wait
    assert rig.report("gcs", "ugv1").queued_bytes == 3000
    rig.until(SECOND)
    report = rig.report("gcs", "ugv1")
    assert (report.frames, report.dropped, report.queued_bytes) == (3, 1, 0)


def test_a_late_timer_takes_nothing_from_the_throughput() -> None:
    rig = RadioRig(radio())
    for number in range(10):
        rig.send("gcs", "ugv1", 0, text=bytes([number]))
    assert len(rig.core.on_timer(10 * MS)) == 10, "ten kilobytes in ten milliseconds"


def test_unicast_repeats_until_received_and_costs_air() -> None:
    draws = iter([0.4, 0.4, 0.6])
    rig = RadioRig(radio(retries=3), chance=lambda: next(draws))
    rig.place(ugv1=(100, 0, 2))
    rig.send("gcs", "ugv1", 0)
    rig.until(SECOND)
    assert [at_ns for at_ns, _ in rig.arrived] == [3 * MS]


def test_unicast_frame_is_lost_after_its_last_repetition() -> None:
    rig = RadioRig(radio(retries=2), chance=lambda: 0.4)
    rig.place(ugv1=(100, 0, 2))
    rig.send("gcs", "ugv1", 0)
    rig.send("gcs", "uav1", 0)
    rig.until(SECOND)
    assert rig.report("gcs", "ugv1").lost == 1
    assert [at_ns for at_ns, _ in rig.arrived] == [4 * MS], "after three transmissions of the lost one"


def test_broadcast_is_lost_per_receiver_without_repetition() -> None:
    draws = iter([0.4, 0.6])
    rig = RadioRig(radio(retries=7), chance=lambda: next(draws))
    rig.place(ugv1=(100, 0, 2), uav1=(-100, 0, 2))
    rig.send("gcs", None, 0)
    rig.until(SECOND)
    assert rig.receivers() == ["uav1"]
    assert rig.arrived[0][0] == MS
    assert rig.report("gcs", "ugv1").lost == 1


def test_link_beyond_its_curve_is_out_of_range() -> None:
    rig = RadioRig(radio())
    rig.place(ugv1=(101, 0, 2))
    rig.send("gcs", "ugv1", 0)
    rig.send("gcs", None, 0)
    rig.until(SECOND)
    assert rig.receivers() == ["uav1"]
    assert (rig.report("gcs", "ugv1").state, rig.report("gcs", "ugv1").lost) == ("out of range", 2)
    rig.place(ugv1=(50, 0, 2))
    assert rig.report("gcs", "ugv1").state == "up"


def test_link_changes_with_positions_of_its_ends() -> None:
    rig = RadioRig(radio(air=(CURVE[0], CurvePoint(distance_m=200, rate_bit_s=4e6, loss_ratio=0.0))))
    rig.place(gcs=(0, 0, 0), ugv1=(30, 40, 0), uav1=(0, 0, 100))
    ground, air = rig.report("gcs", "ugv1"), rig.report("gcs", "uav1")
    assert (ground.distance_m, ground.rate_bit_s, ground.radio_loss_ratio) == (50, 8e6, 0.25)
    assert (air.distance_m, air.rate_bit_s, air.radio_loss_ratio) == (100, 6e6, 0)


def test_cut_stops_all_frames_until_healed() -> None:
    rig = RadioRig(radio(delay_s=1.0))
    rig.send("gcs", "ugv1", 0)
    rig.core.on_cut([rig.link("gcs", "ugv1")], SECOND // 2)
    rig.send("gcs", "ugv1", SECOND // 2)
    rig.send("gcs", None, SECOND // 2)
    rig.send("ugv1", "gcs", SECOND // 2)
    rig.until(3 * SECOND)
    assert sorted(rig.receivers()) == ["gcs", "uav1"], "the other direction is not cut"
    assert (rig.report("gcs", "ugv1").state, rig.report("gcs", "ugv1").cut) == ("cut", 3)
    rig.core.on_heal([rig.link("gcs", "ugv1")], 3 * SECOND)
    rig.send("gcs", "ugv1", 3 * SECOND)
    rig.until(5 * SECOND)
    assert rig.receivers()[-1] == "ugv1"


def test_impairment_adds_named_loss_and_delay_only() -> None:
    rig = RadioRig(chance=lambda: 0.29)
    link = [rig.link("gcs", "uav1")]
    rig.core.on_impairment(link, ImpairmentChange(delay_s=0.05), 0)
    rig.send("gcs", "uav1", 0)
    rig.send("gcs", "ugv1", 0)
    rig.until(SECOND)
    assert [at_ns for at_ns, _ in rig.arrived] == [16_000, 50 * MS + 8000]
    rig.core.on_impairment(link, ImpairmentChange(loss_ratio=0.3), SECOND)
    rig.send("gcs", "uav1", SECOND)
    rig.until(2 * SECOND)
    report = rig.report("gcs", "uav1")
    assert (report.frames, report.lost) == (1, 1)
    assert (report.impairment.delay_s, report.impairment.loss_ratio) == (0.05, 0.3)
    rig.core.on_heal(link, 2 * SECOND)
    rig.send("gcs", "uav1", 2 * SECOND)
    rig.until(3 * SECOND)
    assert rig.arrived[-1][0] == 2 * SECOND + 8000


def test_limited_rate_delays_and_drops_beyond_queue() -> None:
    rig = RadioRig()
    rig.core.on_impairment([rig.link("gcs", "ugv1")], ImpairmentChange(rate_bit_s=80_000), 0)
    for _ in range(70):
        rig.send("gcs", "ugv1", 0)  # a tenth of a second each
    rig.until(100 * SECOND)
    fits = SHAPER_BYTES // 1000
    assert [at_ns // 100_000_000 for at_ns, _ in rig.arrived] == list(range(1, fits + 1))
    report = rig.report("gcs", "ugv1")
    assert (report.frames, report.dropped) == (fits, 70 - fits)


def test_jitter_does_not_reorder() -> None:
    draws = iter([0.5, 0.9, 0.5, 0.1])  # transmission and jitter of each
    rig = RadioRig(chance=lambda: next(draws))
    rig.core.on_impairment([rig.link("gcs", "ugv1")], ImpairmentChange(jitter_s=0.1), 0)
    rig.send("gcs", "ugv1", 0, text=b"1")
    rig.send("gcs", "ugv1", MS, text=b"2")
    rig.until(SECOND)
    assert [got.data[14:15] for _, got in rig.arrived] == [b"1", b"2"]
    assert rig.arrived[0][0] == 90 * MS + 8000 == rig.arrived[1][0] - 1


def test_computers_of_one_vehicle_have_a_wire() -> None:
    rig = RadioRig(radio(), names=("gcs", "uav1", "uav1.nav", "uav1.fc"))
    rig.place(gcs=(5000, 0, 0))
    rig.send("uav1", "uav1.nav", 0)
    rig.send("uav1", None, 0)
    rig.until(SECOND)
    assert rig.receivers() == ["uav1.nav", "uav1.fc", "uav1.nav"]
    assert [at_ns for at_ns, _ in rig.arrived] == [0, 0, 1], "no airtime, and in order"
    assert (rig.report("uav1", "uav1.nav").rate_bit_s, rig.report("uav1", "uav1.nav").state) == (0, "up")
    assert rig.report("uav1", "gcs").lost == 1


def test_the_mean_delay_follows_the_last_frames() -> None:
    rig = RadioRig()
    rig.send("gcs", "ugv1", 0)
    rig.core.on_impairment([rig.link("gcs", "ugv1")], ImpairmentChange(delay_s=0.1), MS)
    for number in range(100):
        rig.send("gcs", "ugv1", (1 + number) * SECOND)
    rig.until(200 * SECOND)
    assert rig.report("gcs", "ugv1").delay_s == pytest.approx(0.1, rel=0.02)


def test_share_of_lost_frames_is_as_set() -> None:
    rig = RadioRig()
    rig.core.on_impairment([rig.link("gcs", "ugv1")], ImpairmentChange(loss_ratio=0.3), 0)
    for number in range(4000):
        rig.send("gcs", "ugv1", number * MS)
    rig.until(10 * SECOND)
    assert rig.report("gcs", "ugv1").lost / 4000 == pytest.approx(0.3, abs=0.03)


NAMES = ("gcs", "ugv1", "uav1", "uav2", "uav2.nav")
SENT = st.tuples(
    st.sampled_from(NAMES),
    st.sampled_from((None, *NAMES)),
    st.integers(60, 1500),
    st.integers(0, 3 * MS),
)


@settings(deadline=None)
@given(
    st.lists(SENT, max_size=60),
    st.lists(st.tuples(st.sampled_from(NAMES), st.floats(0, 150)), max_size=5),
    st.floats(0, 1),
    st.integers(0, 1 << 16),
)
def test_each_frame_arrives_once_or_is_counted(
    sent: list[tuple[str, str | None, int, int]], places: list[tuple[str, float]], loss: float, seed: int
) -> None:
    model = radio(queue_bytes=6000, retries=2, jitter_s=0.01, delay_s=0.001)
    rig = RadioRig(model, names=NAMES, chance=random.Random(seed).random)
    for name, x in places:
        rig.place(0, **{name: (x, 0.0, 2.0)})
    pairs = [rig.link(a, b) for a in NAMES for b in NAMES if a != b]
    rig.core.on_impairment(pairs[::2], ImpairmentChange(loss_ratio=loss, jitter_s=0.02), 0)
    at_ns, expected = 0, 0
    for number, (sender, receiver, size, pause_ns) in enumerate(sent):
        at_ns += pause_ns
        rig.send(sender, receiver, at_ns, size, text=number.to_bytes(4, "big"))
        expected += len(NAMES) - 1 if receiver is None else receiver != sender
    rig.until(at_ns + 60 * SECOND)
    assert rig.core.deadline_ns() is None
    reports = [rig.core.report(one, other, at_ns) for one, other in pairs]
    assert sum(r.frames + r.lost + r.dropped + r.cut for r in reports) == expected
    assert sum(r.frames for r in reports) == len(rig.arrived)
    assert all(r.queued_bytes == 0 for r in reports)
    numbers: dict[tuple[str, int], list[int]] = {}
    for _, got in rig.arrived:
        number = int.from_bytes(got.data[14:18], "big")
        numbers.setdefault((sent[number][0], got.receiver), []).append(number)
    for order in numbers.values():
        assert order == sorted(set(order)), "a link repeats and reorders nothing"


@settings(deadline=None)
@given(st.lists(st.integers(60, 1500), min_size=1, max_size=80), st.integers(2, 4))
def test_a_cell_never_carries_more_than_its_rate(sizes: list[int], nodes: int) -> None:
    names = NAMES[:nodes]
    rig = RadioRig(radio(queue_bytes=1_000_000), names=names)
    for number, size in enumerate(sizes):
        rig.send(names[number % len(names)], None, 0, size)
    rig.until(60 * SECOND)
    assert rig.arrived[-1][0] == sum(sizes) * 1000, "and it is never idle while a frame waits"


def test_model_without_curves_carries_any_distance() -> None:
    rig = RadioRig(PLAIN)
    rig.place(ugv1=(90_000, 0, 0))
    rig.send("gcs", "ugv1", 0)
    rig.until(SECOND)
    assert rig.arrived[0][0] == 8000
