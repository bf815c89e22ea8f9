"""What doctor says of a processor that is short, and of hostile input, read off the broker's board."""

from pathlib import Path

import pytest

from swarmctl.commands.doctor.broker_checks import foreign, hostile_input, processor
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.model.names import data_id
from swarmware.transport.shm.layout import ring_file
from swarmware.transport.shm.ring import RingWriter
from swarmware.types import registry
from swarmware.types.traffic import Refused, Traffic

BOARD = "net/traffic"


def frame(slowed_ticks: int, slowdown: float, refused: Refused | None = None) -> bytes:
    counts = (0,) * 14
    traffic = Traffic(
        0, 1, *counts, 10.0 / slowdown, refused or Refused(), slowed_ticks=slowed_ticks, slowdown=slowdown
    )
    return encode(Frame(FrameKind.BOARD, data_id(BOARD, "Traffic"), payload=registry.encode(traffic)))


@pytest.mark.parametrize(
    ("data", "verdict", "text"),
    [
        (None, "ok", "just started"),
        (frame(0, 1.0), "ok", "10 beacons a second, 0 delayed so far"),
        (frame(70, 1.0), "ok", "70 delayed so far"),
        (frame(70, 4.0), "warning", "processor overloaded: beacons 4 times rarer (70 so far)"),
        (b"x" * 60, "warning", "net/traffic cannot be read"),
    ],
)
def test_a_short_processor_is_named(tmp_path: Path, data: bytes | None, verdict: str, text: str) -> None:
    with RingWriter(ring_file(tmp_path, BOARD), slots=4, slot_bytes=1024) as ring:
        if data is not None:
            ring.write(data)
        found = processor(tmp_path)
    assert (found.check, found.verdict) == ("processor", verdict)
    assert text in found.text


def test_a_board_that_is_not_there_is_named(tmp_path: Path) -> None:
    assert processor(tmp_path).verdict == "warning"


@pytest.mark.parametrize(
    ("data", "found"),
    [
        (None, []),
        (frame(0, 1.0), []),
        (
            frame(0, 1.0, Refused(forged=7)),
            ["7 datagrams that no member has sealed, and that name no other swarm"],
        ),
        (frame(0, 1.0, Refused(other_epoch=3)), ["3 datagrams with a group key that is not known here"]),
        (b"x" * 60, []),
    ],
)
def test_nodes_of_another_swarm_are_named(tmp_path: Path, data: bytes | None, found: list[str]) -> None:
    with RingWriter(ring_file(tmp_path, BOARD), slots=4, slot_bytes=1024) as ring:
        if data is not None:
            ring.write(data)
        assert [one.text.split(":")[0] for one in foreign(tmp_path)] == found


@pytest.mark.parametrize(
    ("refused", "verdict", "text"),
    [
        (Refused(), "ok", "no forged or repeated input"),
        (Refused(unknown_session=9, no_route=3), "ok", "no forged or repeated input"),
        (Refused(replayed=2, denied_connections=1), "ok", "2 replayed, 1 denied_connections"),
        (Refused(forged=3), "warning", "3 forged"),
        (Refused(spoofed=1, expired=4), "warning", "1 spoofed, 4 expired"),
        (Refused(unsigned=1000, denied=7), "warning", "1000 unsigned, 7 denied"),
    ],
)
def test_hostile_input_is_named(tmp_path: Path, refused: Refused, verdict: str, text: str) -> None:
    with RingWriter(ring_file(tmp_path, BOARD), slots=4, slot_bytes=1024) as ring:
        ring.write(frame(0, 1.0, refused))
        [found] = hostile_input(tmp_path)
    assert (found.check, found.verdict, found.text) == ("refused", verdict, text)


def test_delayed_neighbour_commands_are_reported_without_warning(tmp_path: Path) -> None:
    with RingWriter(ring_file(tmp_path, BOARD), slots=4, slot_bytes=1024) as ring:
        ring.write(frame(0, 1.0, Refused(undated=3)))
        undated, refused = hostile_input(tmp_path)
    assert (undated.check, undated.verdict) == ("undated", "ok")
    assert undated.text.startswith("3 commands came before the first beacon")
    assert refused.verdict == "ok"
