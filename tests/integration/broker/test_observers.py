"""An observer that sets, orders, drives or stops: a thousand frames of each verb, all of them refused."""

import logging
from pathlib import Path

import msgspec
import pytest
from tests.integration.broker.hostile import counted, dealer, found_by_doctor
from tests.integration.broker.swarm import Recorder, on_uvloop, swarm
from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmd.tree.records.change_log import ChangeLog
from swarmd.tree.records.denial_log import DenialLog
from swarmware.model.frame import ADDRESSED, Flag, Frame, FrameKind, encode
from swarmware.model.names import data_id, hardware_id
from swarmware.transport.delivery.answer import answerable, with_lifetime
from swarmware.transport.security.keys import Keys
from swarmware.types import registry
from swarmware.types.channel import SetChannel
from swarmware.types.chassis import CalibrationRequest
from swarmware.types.control import DriveRequest
from swarmware.types.health import RestartOrder, StartOrder, StopOrder
from swarmware.types.mission import DrainOrder, MissionAbort, MissionOrder, MissionTask
from swarmware.types.net import SignedRoster
from swarmware.types.scalar import Float, Text
from swarmware.types.tree import TreeChange, TreeReset, TreeRule, TreeSet, TreeUndo
from swarmware.types.vehicle import ArmRequest, KillRequest, Setpoint

TRIES = 1000
REQUEST, MESSAGE = FrameKind.REQUEST, FrameKind.MESSAGE
VERBS: dict[str, tuple[FrameKind, type[msgspec.Struct]]] = {
    "sys/tree/set": (REQUEST, TreeSet),
    "sys/tree/undo": (REQUEST, TreeUndo),
    "sys/tree/reset": (REQUEST, TreeReset),
    "sys/tree/rule": (REQUEST, TreeRule),
    "config/planner/speed_m_s": (MESSAGE, Float),
    "sys/broker/set_channel": (REQUEST, SetChannel),
    "sys/broker/roster": (REQUEST, SignedRoster),
    "sys/mission/task": (REQUEST, MissionTask),
    "cmd/mission": (REQUEST, MissionOrder),
    "sys/mission/abort": (REQUEST, MissionAbort),
    "cmd/abort": (MESSAGE, MissionAbort),
    "sys/mission/drain": (REQUEST, DrainOrder),
    "sys/vehicle/arm": (REQUEST, ArmRequest),
    "sys/vehicle/drive": (REQUEST, DriveRequest),
    "cmd/manual": (MESSAGE, Setpoint),
    "sys/vehicle/kill": (REQUEST, KillRequest),
    "sys/vehicle/calibrate": (REQUEST, CalibrationRequest),
    "sys/guard/restart": (REQUEST, RestartOrder),
    "sys/guard/stop": (REQUEST, StopOrder),
    "sys/guard/start": (REQUEST, StartOrder),
    "plan/upload": (FrameKind.FILE, Text),
    "plan/share": (REQUEST, Text),
}
"""What changes something at a platform; each address with a handler that records a call."""


def order(path: str, kind: FrameKind, name: str, number: int, stamp_ns: int) -> Frame:
    """A frame of an application of uav2."""
    return Frame(
        kind,
        data_id(path, name),
        hardware_id("uav2"),
        1,
        hardware_id("uav1"),
        sequence=number,
        stamp_ns=stamp_ns,
        flags=Flag.WANTS_ACK,
        extension=with_lifetime(60.0),
        payload=registry.encode(Text("hostile")),
    )


@on_uvloop
async def test_an_observer_changes_nothing_by_any_verb(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    port = free_port()
    roles = {"uav1": "node", "uav2": "observer"}
    async with swarm(tmp_path, *roles, roles=roles, settings={"uav1": {"tcp_port": port}}) as cell:
        owner, app = cell["uav1"], cell["uav1"].app
        await owner.until_up("uav2")
        called: list[str] = []
        for path, (kind, cls) in VERBS.items():
            if path.startswith("sys/broker/"):
                continue  # the broker serves it
            address = data_id(path, registry.type_name(cls))
            handler = Recorder(path, called)
            if kind is REQUEST:
                app.serve(path, cls, handler, reply=Text)
                app.node.messaging.serve_requests(address, app.app_id, handler.ask)
            else:
                app.inbox(path, cls)
                app.node.messaging.serve_messages(address, app.app_id, handler.take)
        keys = Keys.load(tmp_path / "keys" / "uav2", "uav2")
        server = keys.curve_of("uav1")
        assert server is not None
        changes = app.stream_writer("tree/changes", TreeChange, kind="event")
        record = ChangeLog(app, changes, tmp_path / "changes.jsonl")
        audit = app.start(DenialLog(app, record).follow_broker(), "audit")
        recorded = app.stream_reader("tree/changes", TreeChange)
        caplog.set_level(logging.WARNING)
        refused, number = 0, 0
        async with dealer(keys, server, port) as connection:
            for path, (kind, cls) in VERBS.items():
                name = registry.type_name(cls)
                for _ in range(TRIES):
                    number += 1
                    frame = order(path, kind, name, number, cell["uav2"].app.now_ns())
                    connection.send(encode(frame))
                refused += TRIES
                assert (await counted(owner, "denied", refused)).denied == refused, path
                while (change := await recorded.next(PATIENCE_S)).path != f"/uav1/{path}":
                    assert change.refused.endswith(" times)"), "what came after the report of a former one"
                assert change.by == "observer@uav2"
                assert f"{path}: observer@uav2 may not call it; expected role" in change.refused
            # no kind of frame is a way around
            for kind in FrameKind:
                for path, (_, cls) in VERBS.items():
                    number += 1
                    frame = order(path, kind, registry.type_name(cls), number, cell["uav2"].app.now_ns())
                    connection.send(encode(frame))
                    refused += answerable(frame)
            assert (await counted(owner, "denied", refused)).denied == refused
            assert len(ADDRESSED) + 1 == refused // len(VERBS) - TRIES
            assert called == []
        assert await owner.app.send("plan/upload", Text("own"), timeout_s=PATIENCE_S, kind=FrameKind.FILE)
        assert called == ["plan/upload"]
        audit.cancel()

        lines = [record.getMessage() for record in caplog.records]
        assert {
            path for path in VERBS if any(f"denied: {path}: observer@uav2" in line for line in lines)
        } == {*VERBS}
        assert len(lines) < 10 * len(VERBS)
        await owner.until_counted(lambda traffic: traffic.refused.denied == refused)
        assert f"{refused} denied" in (await found_by_doctor(owner, "refused")).text
        assert (await found_by_doctor(owner, "denied")).text.startswith("observer@uav2: ")
