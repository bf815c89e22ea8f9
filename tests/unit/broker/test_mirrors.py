"""Values of other platforms in shared memory: whole frames, whatever the value before was like."""

import asyncio
from pathlib import Path
from typing import Final

import pytest

from swarmd.broker.boards.shared_boards import MirroredBoards
from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmd.broker.core.traffic import Counters
from swarmware.errors import WireError
from swarmware.model.frame import Codec, Frame, FrameKind, decode, encode, restamp
from swarmware.model.names import data_id
from swarmware.node.mirror_writer import MirrorWriter
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.shm.layout import ring_file
from swarmware.transport.shm.ring import RingReader
from swarmware.types.net import BoardSubscription

POSE: Final = data_id("nav/pose", "Pose")
WANT: Final = BoardSubscription("uav7", "nav/pose", "Pose", POSE)
OTHER_TYPE: Final = BoardSubscription("uav7", "nav/pose", "Text", data_id("nav/pose", "Text"))


def test_mirrored_frame_equals_fresh_encoding(tmp_path: Path) -> None:
    written = [
        (WANT, RemoteValue(7, POSE, 1_000, 10, True, b"here", 5_000_000)),
        (WANT, RemoteValue(7, POSE, 2_000, 20, True, b"ther", 6_000_000)),
        (WANT, RemoteValue(7, POSE, 2_500, 20, True, b"farther", 7_000_000)),
        (WANT, RemoteValue(7, POSE, 3_000, 70_000, False, b"unpackd", 8_000_000)),
        (WANT, RemoteValue(8, POSE, -3_000, 0, False, b"another", -9_000_000)),
        (OTHER_TYPE, RemoteValue(8, POSE, 4_000, 0, False, b"another", 10_000_000)),
    ]

    async def run() -> None:
        async with tmp_node(tmp_path) as node:
            mirrors = MirroredBoards(MirrorWriter(node), Counters())
            ring: RingReader | None = None
            for sequence, (want, value) in enumerate(written, start=1):
                assert mirrors.write(want, value)
                ring = ring or RingReader(ring_file(node.shm_dir, "nav/pose", "uav7"))
                expected = Frame(
                    FrameKind.BOARD,
                    want.data_id,
                    value.origin_hw,
                    sequence=sequence,
                    stamp_ns=value.stamp_us * 1000,
                    echo_rx_us=value.rx_ns // 1000 - value.age_us,
                    codec=Codec.PACKED if value.packed else Codec.NONE,
                    payload=value.payload,
                )
                assert ring.newest() == encode(expected)
            assert ring is not None
            ring.close()
            mirrors.close()

    asyncio.run(run())


def test_restarted_broker_continues_numbers_of_mirror(tmp_path: Path) -> None:
    async def run() -> None:
        async with tmp_node(tmp_path) as node:
            for start in range(2):
                mirrors = MirroredBoards(MirrorWriter(node), Counters())
                for number in range(2):
                    mirrors.write(WANT, RemoteValue(7, POSE, number, 0, True, b"here", 0))
                mirrors.close()
                with RingReader(ring_file(node.shm_dir, "nav/pose", "uav7")) as ring:
                    newest = ring.newest()
                    assert newest is not None
                    assert decode(newest).sequence == ring.sequence == 2 * start + 2

    asyncio.run(run())


def test_a_stamp_that_fits_no_frame_is_refused() -> None:
    frame = bytearray(encode(Frame(FrameKind.BOARD, POSE, payload=b"here")))
    with pytest.raises(WireError, match="stamp_ns is"):
        restamp(frame, 1, 1 << 63)
    assert bytes(frame) == encode(Frame(FrameKind.BOARD, POSE, payload=b"here"))


def test_value_without_frame_is_refused_and_reported_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def run() -> None:
        async with tmp_node(tmp_path) as node:
            counters = Counters()
            mirrors = MirroredBoards(MirrorWriter(node), counters)
            hostile = RemoteValue(7, POSE, 1 << 62, 10, True, b"here", 5_000_000)
            for _ in range(3):
                assert not mirrors.write(WANT, hostile)
            assert not ring_file(node.shm_dir, "nav/pose", "uav7").exists()
            assert mirrors.write(WANT, RemoteValue(7, POSE, 1_000, 10, True, b"here", 5_000_000))
            assert counters.refused.malformed == 3
            mirrors.close()

    asyncio.run(run())
    assert [record.getMessage()[:27] for record in caplog.records] == ["mirror of /uav7/nav/pose: f"]
