"""Users of a computer have the rights that acl.toml gives them, by the credentials of their sockets."""

import asyncio
import os
import pwd
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.integration.broker.hostile import found_by_doctor
from tests.integration.broker.swarm import LINE, Recorder, Station, on_uvloop, swarm
from tests.patience import PATIENCE_S

from swarmd.tree.records.change_log import ChangeLog
from swarmd.tree.records.denial_log import DenialLog
from swarmware.model.access import Role, Sender
from swarmware.model.acl import FILE
from swarmware.model.frame import ADDRESSED, Flag, Frame, FrameKind, decode, encode
from swarmware.model.names import data_id, hardware_id
from swarmware.module.module import Module
from swarmware.transport.delivery.answer import with_lifetime
from swarmware.transport.delivery.outcome import Status
from swarmware.transport.delivery.sender import Caller, with_caller
from swarmware.transport.messaging.zmtp import DEALER, ZmtpConnection, message
from swarmware.types import registry
from swarmware.types.net import Denial
from swarmware.types.rpc import Ack, Reply
from swarmware.types.scalar import Text
from swarmware.types.tree import TreeChange

USER = pwd.getpwnam("nobody")
PATH = "cmd/note"
TRIES = 1000

pytestmark = pytest.mark.root


class Program:
    """A program of another user, connected to a process of the node as the protocol page says it."""

    def __init__(self, sock: socket.socket) -> None:
        self._socket = sock
        self._zmtp = ZmtpConnection(DEALER)
        self._sequence = 0
        self._messages: list[bytes] = []

    async def ready(self) -> None:
        while not self._zmtp.is_ready:
            await self._flush()
            self._messages += self._zmtp.receive(await self._receive())
        await self._flush()

    async def _flush(self) -> None:
        await asyncio.get_running_loop().sock_sendall(self._socket, self._zmtp.take_output())

    async def _receive(self) -> bytes:
        async with asyncio.timeout(PATIENCE_S):
            return await asyncio.get_running_loop().sock_recv(self._socket, 65536)

    async def send(self, station: Station, to: str) -> None:
        """Sends a message to a platform, with a false statement of its own rights."""
        await self.send_frame(self.frame(station, to))

    def frame(
        self,
        station: Station,
        to: str,
        kind: FrameKind = FrameKind.MESSAGE,
        path: str = PATH,
        name: str = "Text",
    ) -> Frame:
        self._sequence += 1
        return Frame(
            kind,
            data_id(path, "Text"),
            station.node.hardware,
            77,
            hardware_id(to),
            sequence=self._sequence,
            stamp_ns=station.app.now_ns(),
            flags=Flag.WANTS_ACK,
            extension=with_caller(with_lifetime(10.0), Caller("root", Role.MAINTAINER)),
            payload=registry.encode(Text("note")),
        )

    async def send_frame(self, frame: Frame) -> None:
        await asyncio.get_running_loop().sock_sendall(self._socket, message(encode(frame)))

    async def answer(self) -> Ack:
        """Next answer of this node; answers of other nodes go to applications on the node's table."""
        return registry.decode(Ack, (await self.answer_frame()).payload)

    async def answer_frame(self) -> Frame:
        while not self._messages:
            self._messages += self._zmtp.receive(await self._receive())
        return decode(self._messages.pop(0))

    async def refusal(self) -> str:
        """Reason of a refused message or request, or "" if it was delivered."""
        frame = await self.answer_frame()
        if frame.kind is FrameKind.REPLY:
            return registry.decode(Reply, frame.payload).error
        ack = registry.decode(Ack, frame.payload)
        return "" if ack.status == Status.DELIVERED else ack.detail


@contextmanager
def program_of_nobody(station: Station) -> Iterator[Program]:
    """A connection of user nobody to the process of a node."""
    path = Path(station.node.messaging.address.removeprefix("ipc://"))
    path.parent.chmod(0o755)
    path.chmod(0o666)
    here = Path.cwd()
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as sock:
        os.chdir(path.parent)  # nobody may not enter the folders above
        os.seteuid(USER.pw_uid)
        try:
            sock.connect(path.name)
        finally:
            os.seteuid(0)
            os.chdir(here)
        sock.setblocking(False)
        yield Program(sock)


@on_uvloop
async def test_user_without_role_commands_no_platform(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "gcs") as pair:
        own, far = pair["gcs"], pair["uav1"]
        boxes = [station.app.inbox(PATH, Text) for station in pair.values()]
        denials = far.app.stream_reader("net/denials", Denial)
        await own.until_up("uav1")
        await far.until_up("gcs")
        with program_of_nobody(own) as program:
            await program.ready()
            for number in range(TRIES):
                await program.send(own, "uav1" if number % 2 else "gcs")
                if number % 2 == 0:
                    detail = (await program.answer()).detail
                    assert "nobody@gcs (observer) may not call it; expected role operator" in detail
            await far.until_counted(lambda traffic: traffic.refused.denied >= TRIES // 2)
        assert [len(box) for box in boxes] == [0, 0]
        assert (await far.traffic()).refused.denied == TRIES // 2
        denial = await denials.next(PATIENCE_S)
        assert (denial.platform, denial.path) == ("gcs", PATH)
        assert await own.app.send("/uav1/cmd/note", Text("of the platform"), timeout_s=PATIENCE_S)


@on_uvloop
async def test_denial_by_process_is_in_audit_and_doctor(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with swarm(tmp_path, "uav1") as one:
        station, app = one["uav1"], one["uav1"].app
        app.serve("sys/guard/stop", Text, lambda request, _: request, reply=Text)
        async with Module("tree", node=station.node) as tree:
            changes = tree.stream_writer("tree/changes", TreeChange, kind="event")
            log = DenialLog(tree, ChangeLog(tree, changes, tmp_path / "changes.jsonl"))
            audit = tree.start(log.follow_processes(), "audit")
            recorded = app.stream_reader("tree/changes", TreeChange)
            with program_of_nobody(station) as program:
                await program.ready()
                for _ in range(TRIES):
                    frame = program.frame(station, "uav1", FrameKind.REQUEST, "sys/guard/stop")
                    await program.send_frame(frame)
                    assert "nobody@uav1 (observer) may not call it" in await program.refusal()
            change = await recorded.next(PATIENCE_S)
            assert (change.path, change.by) == ("/uav1/sys/guard/stop", "nobody@uav1")
            assert "expected role maintainer" in change.refused
            audit.cancel()
            found = await found_by_doctor(station, "denied")
            assert found.text.startswith("nobody@uav1: sys/guard/stop: ")
            assert "acl.toml" in found.advice
        assert app.node.messaging.counters().denied == TRIES
        assert 1 <= len([line for line in caplog.messages if "denied: sys/guard/stop" in line]) < TRIES / 10


@on_uvloop
async def test_named_operator_is_known_at_other_end(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2", "uav3", hear=LINE) as line:
        own, far = line["uav3"], line["uav1"]
        (own.config_dir / FILE).write_text('[[operator]]\nuser = "nobody"\nname = "anna"\n')
        box = far.app.inbox(PATH, Text)
        mine = own.app.inbox(PATH, Text)
        await own.until_reaches(uav1="uav2")
        await far.until_reaches(uav3="uav2")
        with program_of_nobody(own) as program:
            await program.ready()
            await program.send(own, "uav1")
            await box.next(PATIENCE_S)
            assert box.meta is not None
            assert box.meta.sender == Sender("uav3", Role.OPERATOR, "anna", ("uav2",))
            await program.send(own, "uav3")
            assert (await program.answer()).status == Status.DELIVERED
            await mine.next(PATIENCE_S)
            assert mine.meta is not None
            assert str(mine.meta.sender) == "anna@uav3"


KINDS = {
    "cmd/note": FrameKind.MESSAGE,
    "sys/guard/stop": FrameKind.REQUEST,
    "config/planner/speed_m_s": FrameKind.MESSAGE,
    "sys/tree/set": FrameKind.REQUEST,
    "plan/images": FrameKind.STREAM,
    "plan/upload": FrameKind.FILE,
    "sys/node/info": FrameKind.REQUEST,
}
"""A command, requests, a setting, the tree, a stream, a file, and a board that every role may read."""


@pytest.mark.parametrize(
    ("role", "may"),
    [
        ("", {"sys/node/info"}),
        ("node", {"sys/node/info", "sys/tree/set", "plan/images", "plan/upload"}),
        ("operator", {*KINDS} - {"sys/guard/stop"}),
        ("maintainer", {*KINDS}),
    ],
    ids=["no entry", "node", "operator", "maintainer"],
)
def test_module_of_another_user_has_rights_of_credentials(tmp_path: Path, role: str, may: set[str]) -> None:
    @on_uvloop
    async def run() -> None:
        async with swarm(tmp_path, "uav1") as one:
            station, app = one["uav1"], one["uav1"].app
            if role:
                text = f'[[operator]]\nuser = "nobody"\nrole = "{role}"\n'
                (station.config_dir / FILE).write_text(text)
            called: list[str] = []
            for path, kind in KINDS.items():
                if kind is FrameKind.REQUEST:
                    reply = Recorder(path, called)
                    app.serve(path, Text, reply, reply=Text)
                else:
                    app.inbox(path, Text)
                    box = Recorder(path, called)
                    app.node.messaging.serve_messages(data_id(path, "Text"), app.app_id, box.take)
            with program_of_nobody(station) as program:
                await program.ready()
                for path, kind in KINDS.items():
                    await program.send_frame(program.frame(station, "uav1", kind, path))
                    reason = await program.refusal()
                    assert (reason == "") is (path in may), (path, reason)
                    assert reason == "" or f"{path}: nobody@uav1" in reason
                assert set(called) == may
                counters = app.node.messaging.counters()
                assert counters.denied == len(KINDS) - len(may)
                # to an address that is served, but is on no table yet: no right can be checked
                app.node.messaging.serve_messages(data_id("cmd/new", "Text"), app.app_id, box.take)
                await program.send_frame(program.frame(station, "uav1", path="cmd/new"))
                assert "no application here takes" in await program.refusal()

    run()


@on_uvloop
async def test_another_user_cannot_answer_for_module_or_session(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "gcs") as pair:
        own = pair["uav1"]
        await own.until_up("gcs")
        held = asyncio.get_running_loop().create_future()
        own.app.serve("plan/slow", Text, lambda _, __: held, reply=Text)
        waiting = own.app.start(own.app.request("plan/slow", Text(""), Text, timeout_s=PATIENCE_S), "asked")
        await asyncio.sleep(0)
        malformed = own.node.messaging.counters().malformed
        with program_of_nobody(own) as program:
            await program.ready()
            tries = 0
            for kind in set(FrameKind) - ADDRESSED - {FrameKind.REQUEST}:
                for to in ("uav1", "gcs"):
                    for sequence in range(50):
                        frame = program.frame(own, to, kind, "plan/slow")
                        frame.receiver_app, frame.sequence = own.app.app_id, sequence
                        frame.payload = registry.encode(Reply(True, registry.encode(Text("false"))))
                        await program.send_frame(frame)
                        tries += 1
            await program.send(own, "uav1")  # after all of these
            await program.answer()
        assert own.node.messaging.counters().malformed == malformed + tries
        assert not waiting.done()
        held.set_result(Text("true"))
        assert (await waiting).value == "true"
        await own.until_up("gcs")
