"""Users of a computer have the rights that acl.toml gives them, by the credentials of their sockets."""

import asyncio
import os
import pwd
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.integration.broker.swarm import LINE, PATIENCE_S, Station, on_uvloop, swarm

from swarmware.model.access import Role, Sender
from swarmware.model.acl import FILE
from swarmware.model.frame import Frame, FrameKind, decode, encode
from swarmware.model.names import data_id, hardware_id
from swarmware.transport.delivery.answer import with_lifetime
from swarmware.transport.delivery.outcome import Status
from swarmware.transport.delivery.sender import Caller, with_caller
from swarmware.transport.messaging.zmtp import DEALER, ZmtpConnection, message
from swarmware.types import registry
from swarmware.types.net import Denial
from swarmware.types.rpc import Ack
from swarmware.types.scalar import Text

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
        self._sequence += 1
        frame = Frame(
            FrameKind.MESSAGE,
            data_id(PATH, "Text"),
            station.node.hardware,
            77,
            hardware_id(to),
            sequence=self._sequence,
            stamp_ns=station.app.now_ns(),
            extension=with_caller(with_lifetime(10.0), Caller("root", Role.MAINTAINER)),
            payload=registry.encode(Text("note")),
        )
        await asyncio.get_running_loop().sock_sendall(self._socket, message(encode(frame)))

    async def answer(self) -> Ack:
        """The next answer of this node; those of others go to applications that are on the node's table."""
        while not self._messages:
            self._messages += self._zmtp.receive(await self._receive())
        return registry.decode(Ack, decode(self._messages.pop(0)).payload)


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
async def test_a_user_without_a_role_commands_neither_the_own_platform_nor_another(tmp_path: Path) -> None:
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
        assert await own.app.send("/uav1/cmd/note", Text("of the platform"), timeout_s=10)


@on_uvloop
async def test_a_named_operator_is_known_at_the_other_end_with_the_path_of_its_frame(tmp_path: Path) -> None:
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
