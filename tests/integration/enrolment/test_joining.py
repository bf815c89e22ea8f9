"""Joining through others: an answer is lost, a refusal is forged, a token comes by stdin or file."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import msgspec
from tests.integration.enrolment.operator_commands import Operator, ended
from tests.patience import PATIENCE_S

from swarmware.testing.tmpnode import make_node
from swarmware.transport.enrolment.messages import SIZE_BYTES, JoinRefusal, refuse
from swarmware.transport.enrolment.token import JoinToken
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.root import Root

Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]
Conduct = Callable[[Streams, Streams], Awaitable[None]]
"""Handler of a connection to the inviter; takes the node's streams, then the inviter's streams."""


async def message(reader: asyncio.StreamReader) -> bytes:
    """One message with its size."""
    size = await reader.readexactly(SIZE_BYTES)
    return size + await reader.readexactly(int.from_bytes(size, "big"))


async def pass_on(node: Streams, inviter: Streams) -> None:
    inviter[1].write(await message(node[0]))
    node[1].write(await message(inviter[0]))
    with suppress(asyncio.IncompleteReadError):  # a receipt, unless the answer was a refusal
        inviter[1].write(await message(node[0]))
        await inviter[1].drain()


async def lose_answer(node: Streams, inviter: Streams) -> None:
    inviter[1].write(await message(node[0]))
    await message(inviter[0])


async def lose_receipt(node: Streams, inviter: Streams) -> None:
    inviter[1].write(await message(node[0]))
    node[1].write(await message(inviter[0]))
    await message(node[0])


async def forge_refusal(node: Streams, _: Streams) -> None:
    await message(node[0])
    data = refuse(JoinRefusal.USED)
    node[1].write(len(data).to_bytes(SIZE_BYTES, "big") + data)
    await node[1].drain()


class Between:
    """Computers between a node and its inviter, each at an address of its own."""

    def __init__(self, port: int, *conducts: tuple[str, Conduct]) -> None:
        self._inviter_port = port
        self._conducts = dict(conducts)
        self.port = 0

    async def open(self) -> list[asyncio.Server]:
        servers = []
        for host, conduct in self._conducts.items():

            async def serve(
                reader: asyncio.StreamReader, writer: asyncio.StreamWriter, conduct: Conduct = conduct
            ) -> None:
                inviter = await asyncio.open_connection("127.0.0.1", self._inviter_port)
                with suppress(asyncio.IncompleteReadError, ConnectionError):
                    await conduct((reader, writer), inviter)
                for end in (writer, inviter[1]):
                    end.close()

            servers.append(await asyncio.start_server(serve, host, self.port))
            self.port = servers[-1].sockets[0].getsockname()[1]
        return servers


@asynccontextmanager
async def between(token: str, *conducts: tuple[str, Conduct]) -> AsyncIterator[str]:
    """Token with the addresses of the computers between the node and the inviter."""
    parsed = JoinToken.parse(token)
    proxies = Between(parsed.port, *conducts)
    servers = await proxies.open()
    try:
        hosts = tuple(host for host, _ in conducts)
        yield msgspec.structs.replace(parsed, hosts=hosts, port=proxies.port).text()
    finally:
        for server in servers:
            server.close()
            await server.wait_closed()


class Inviting:
    """A ground station that invites uav1, and the node of uav1."""

    def __init__(self, root: Path) -> None:
        self.base, self.vehicle = make_node(root, "gcs", kind="gcs"), make_node(root, "uav1")
        self._root = root / "root"
        self.operator = Operator(self._root)
        self.process: asyncio.subprocess.Process

    async def begin(self) -> str:
        """The token."""
        await self.operator.keys(self.base, "init")
        self.process = await self.operator.start(
            self.base, "invite", "uav1", "--address", "127.0.0.1", "--valid", "60s"
        )
        assert self.process.stdout is not None
        async with asyncio.timeout(PATIENCE_S):
            return (await self.process.stdout.readline()).decode().split()[3]

    async def join(self, *words: str, stdin: bytes = b"") -> tuple[int | None, str]:
        """Exit code of `keys join`, and what it says."""
        process = await self.operator.start(self.vehicle, "join", *words)
        async with asyncio.timeout(PATIENCE_S):
            out, err = await process.communicate(stdin)
        return process.returncode, (out + err).decode()

    def joined(self) -> bool:
        """Whether the node has the identity that the root has signed."""
        keys = Keys.load(self.vehicle.parent / "keys", "uav1")
        member = Root.load(self._root).roster.find("uav1")
        return member is not None and keys.roster == Root.load(self._root).roster

    async def end(self) -> str:
        """What the inviter has said when it has ended by itself."""
        return await ended(self.process)

    async def kill(self) -> None:
        if self.process.returncode is None:
            self.process.kill()
        await self.process.communicate()


@asynccontextmanager
async def inviting(root: Path) -> AsyncIterator[tuple[Inviting, str]]:
    found = Inviting(root)
    token = await found.begin()
    try:
        yield found, token
    finally:
        await found.kill()


async def test_lost_answer_is_given_again_to_same_line(tmp_path: Path) -> None:
    async with inviting(tmp_path) as (found, token):
        async with between(token, ("127.0.0.1", lose_answer)) as through:
            code, said = await found.join(through)
        assert (code, "the same line again" in said) == (4, True), said
        assert found.process.returncode is None, "it waits for the node, whose answer was lost"
        code, said = await found.join(token)
        assert code == 0, said
        assert found.joined()
        await found.end()


async def test_inviter_answers_again_after_lost_receipt(tmp_path: Path) -> None:
    async with inviting(tmp_path) as (found, token):
        async with between(token, ("127.0.0.1", lose_receipt)) as through:
            code, said = await found.join(through)
        assert code == 0, said
        assert found.joined()
        assert found.process.returncode is None, "it does not know that the node has its keys"


async def test_behind_forged_refusal_next_address_is_asked(tmp_path: Path) -> None:
    async with inviting(tmp_path) as (found, token):
        ways = (("127.0.0.2", forge_refusal), ("127.0.0.1", pass_on))
        async with between(token, *ways) as through:
            code, said = await found.join(through)
        assert code == 0, said
        assert found.joined()
        await found.end()


async def test_unsigned_refusal_is_reported_when_no_address_admits(
    tmp_path: Path,
) -> None:
    async with inviting(tmp_path) as (found, token):
        ways = (("127.0.0.2", lose_answer), ("127.0.0.1", forge_refusal))
        async with between(token, *ways) as through:
            code, said = await found.join(through)
        assert code == 5, said
        assert "127.0.0.2: the connection ended before the answer" in said
        assert "127.0.0.1: uav1: the token was used (unsigned: any computer may have sent it)" in said


async def test_token_is_absent_from_list_of_processes(tmp_path: Path) -> None:
    async with inviting(tmp_path) as (found, token):
        (tmp_path / "token").write_text(f"{token}x\n")
        code, said = await found.join(f"@{tmp_path / 'token'}")
        assert code == 7 and "mistyped" in said, said
        code, said = await found.join("-", stdin=f"{token}\n".encode())
        assert code == 0, said
        assert found.joined()
        await found.end()
