"""Commands as they were accepted: kept once for the logger where the template says so, and nothing else."""

import asyncio
from pathlib import Path

from tests.patience import PATIENCE_S

from swarmware.model.frame import Flag, Frame, FrameKind, decode
from swarmware.model.names import ANY, data_id, hardware_id
from swarmware.module.accepted import SLOTS
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.delivery.sender import with_sender
from swarmware.transport.shm.layout import ring_file
from swarmware.transport.shm.ring import RingReader
from swarmware.types import registry
from swarmware.types.mission import MissionAbort
from swarmware.types.scalar import Text
from swarmware.types.vehicle import ArmRequest, VehicleState


def kept(ring: RingReader) -> list[Frame]:
    """What the logger would take."""
    found = []
    while (data := ring.next()) is not None:
        found.append(decode(data))
    return found


async def test_logged_command_is_kept_once(tmp_path: Path) -> None:
    far = hardware_id("uav7")
    async with tmp_node(tmp_path) as node, Module("mission", node=node) as m:
        m.inbox("cmd/abort", MissionAbort)
        began_ns = node.clock.now_ns()
        with RingReader(ring_file(node.shm_dir, "cmd/abort"), after=0) as ring:
            for sequence in (1, 1, 2):
                frame = Frame(
                    FrameKind.MESSAGE,
                    data_id("cmd/abort", "MissionAbort"),
                    far,
                    9,
                    node.hardware,
                    ANY,
                    sequence,
                    stamp_ns=5,
                    flags=Flag.WANTS_ACK,
                    payload=registry.encode(MissionAbort(reason=f"no {sequence}")),
                )
                frame.extension = with_sender(frame.extension, None, 4_000)
                node.messaging.deliver(frame)
                await asyncio.sleep(0)
            found = kept(ring)
        assert [(frame.sequence, frame.sender_hw) for frame in found] == [(1, far), (2, far)]
        assert all(frame.stamp_ns >= began_ns for frame in found), "stamped with our clock, at its acceptance"


async def test_request_is_kept_and_unlogged_is_not(tmp_path: Path) -> None:
    async with tmp_node(tmp_path, template="multirotor") as node, Module("sim", node=node) as m:
        m.serve("sys/vehicle/arm", ArmRequest, lambda *_: VehicleState(True, True), reply=VehicleState)
        box = m.inbox("test/private", Text)
        await m.request("sys/vehicle/arm", ArmRequest(True), VehicleState)
        assert await m.send("test/private", Text("x"))
        assert await box.next(PATIENCE_S) == Text("x")
        with RingReader(ring_file(node.shm_dir, "sys/vehicle/arm"), after=0) as ring:
            assert [registry.decode(ArmRequest, frame.payload) for frame in kept(ring)] == [ArmRequest(True)]
        assert not ring_file(node.shm_dir, "test/private").exists()


async def test_accepted_commands_outlive_application_for_logger(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        async with Module("mission", node=node) as m:
            m.inbox("cmd/abort", MissionAbort, limit=2 * SLOTS)
            for number in range(3):
                assert await m.send("cmd/abort", MissionAbort(reason=f"no {number}"))
        with RingReader(ring_file(node.shm_dir, "cmd/abort"), after=0) as ring:
            assert not ring.owner_alive(), "its writer has let it go, so the next application may have it"
            assert len(kept(ring)) == 3
        async with Module("mission", node=node) as m:
            m.inbox("cmd/abort", MissionAbort)
            assert await m.send("cmd/abort", MissionAbort(reason="again"))
        with RingReader(ring_file(node.shm_dir, "cmd/abort"), after=3) as ring:
            assert [registry.decode(MissionAbort, one.payload).reason for one in kept(ring)] == ["again"]
