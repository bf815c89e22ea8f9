"""Packets of a lidar become the points of whole turns, also of a real recording; garbage is counted."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.lidar.packets import PACKET, recording, turn, wall

from swarmd.lidar.core.turn_decoder import Turn, TurnDecoder


def decoded(
    packets: list[bytes], batch: int = 16, forward_deg: float = 0.0
) -> tuple[TurnDecoder, list[Turn]]:
    decoder = TurnDecoder(forward_deg)
    found = []
    for at in range(0, len(packets), batch):
        found += decoder.turns(packets[at : at + batch], at)
    return decoder, found


def nearest(points: Any, x_m: float, y_m: float) -> float:
    return float(np.hypot(points[:, 0] - x_m, points[:, 1] - y_m).min())


def test_wall_ahead_is_plane_of_points_in_front() -> None:
    _, (first,) = decoded([*turn(wall(5.0)), turn(wall(5.0))[0]])
    assert first.points[:, 0] == pytest.approx(5.0, abs=0.01), "2 mm of distance and 0.01 degrees"
    assert nearest(first.points, 5.0, 3.0) < 0.1
    assert nearest(first.points, 5.0, -3.0) < 0.1
    assert {round(math.degrees(math.asin(z / math.hypot(5.0, y, z)))) for _, y, z in first.points} == set(
        range(-15, 16, 2)
    )


def test_turn_begins_at_azimuth_that_points_forward() -> None:
    _, (first, second) = decoded(turn(wall(5.0)) * 2, forward_deg=90.0)
    assert len(second.points) > len(first.points), "the first one was begun when the vehicle was started"
    assert second.points[:, 1] == pytest.approx(5.0, abs=0.01), "the wall is to the left of the vehicle"


def test_points_are_same_whatever_packets_that_come_together() -> None:
    packets = turn(wall(5.0)) * 2
    one, other = (decoded(packets, batch)[1][0].points for batch in (16, 75))
    assert np.abs(one - other).max() < 0.02


def test_a_real_recording_has_ten_turns_a_second() -> None:
    decoder, turns = decoded(recording())
    assert decoder.refused == 0
    assert len(turns) == 13, "1 000 packets at 753 in a second"
    assert all(15_000 < len(one.points) < 16_000 for one in turns[1:])
    assert all(np.abs(one.points).max() < 130.0 for one in turns)
    assert [one.stamp_ns for one in turns] == sorted(one.stamp_ns for one in turns)


def test_foreign_packets_are_counted_and_ignored() -> None:
    good = turn(wall(5.0))
    broken = bytes(2) + good[3][2:]
    decoder, turns = decoded([*good[:3], b"", b"x" * 500, bytes(PACKET), broken, *good[3:], good[0]])
    assert decoder.refused == 2 + 12 + 1
    assert len(turns) == 1
    assert turns[0].points[:, 0] == pytest.approx(5.0, abs=0.01)


def test_a_lidar_whose_motor_stands_takes_no_memory() -> None:
    decoder = TurnDecoder()
    (packet,) = turn(wall(5.0), blocks=12)
    turns = [one for _ in range(40) for one in decoder.turns([packet] * 16, 0)]
    assert turns
    assert max(len(one.points) for one in turns) < 200_000


@given(st.lists(st.one_of(st.binary(max_size=40), st.binary(min_size=PACKET, max_size=PACKET)), max_size=4))
def test_no_bytes_end_the_decoder(packets: list[bytes]) -> None:
    decoder = TurnDecoder()
    decoder.turns(packets, 0)
    assert decoder.refused >= sum(len(packet) != PACKET for packet in packets)
