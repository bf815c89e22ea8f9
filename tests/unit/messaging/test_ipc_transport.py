"""The Unix sockets of a process: nothing lost that was acknowledged, nothing waited for, bounded queues."""

import asyncio
import errno
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
import zmq
from tests.patience import PATIENCE_S, until

from swarmware.errors import InvalidInput
from swarmware.testing.leaks import no_leaks
from swarmware.transport.messaging import ipc_transport
from swarmware.transport.messaging.ipc_transport import (
    QUEUE_BYTES,
    QUEUE_LIMIT,
    IpcConnection,
    IpcTransport,
)
from swarmware.transport.messaging.zmtp import ROUTER, ZmtpConnection

GREETING = ZmtpConnection(ROUTER).take_output()


class Process:
    """A process's transport, and what it received, in order."""

    def __init__(self, path: Path) -> None:
        self._queue: asyncio.Queue[tuple[bytes, IpcConnection]] = asyncio.Queue()
        self.reasons: list[str] = []
        self.transport = IpcTransport(path, self._on_data, self.reasons.append)
        self.address = self.transport.address

    def _on_data(self, data: bytes, connection: IpcConnection) -> None:
        self._queue.put_nowait((data, connection))

    async def next(self) -> tuple[bytes, IpcConnection]:
        return await asyncio.wait_for(self._queue.get(), PATIENCE_S)


@asynccontextmanager
async def processes(folder: Path, *names: str) -> AsyncIterator[list[Process]]:
    made = [Process(folder / name) for name in names]
    try:
        yield made
    finally:
        for one in made:
            one.transport.close()


async def test_messages_and_answers_pass_in_order(tmp_path: Path) -> None:
    with no_leaks(tmp_path):
        async with processes(tmp_path, "a", "b") as (here, there):
            for number in range(300):
                assert here.transport.send(there.address, b"%d" % number)
            for number in range(300):
                data, back = await there.next()
                assert data == b"%d" % number
                assert back.send(b"to " + data, urgent=False)
            assert [(await here.next())[0] for _ in range(300)] == [b"to %d" % n for n in range(300)]


async def test_last_answer_of_process_that_ends_arrives(tmp_path: Path) -> None:
    async with processes(tmp_path, "a", "b") as (here, there):
        here.transport.send(there.address, b"question")
        _, back = await there.next()
        assert back.send(b"answer", urgent=False)
        there.transport.close()
        here.transport.send(there.address, b"nobody reads this, and its sender gets a broken pipe")
        assert (await here.next())[0] == b"answer"


def read_all(listener: socket.socket) -> list[bytes]:
    """What the first process that connects sends, until it ends."""
    peer, _ = listener.accept()
    end = ZmtpConnection(ROUTER)
    received: list[bytes] = []
    with peer:
        peer.sendall(end.take_output())
        while data := peer.recv(65536):
            received += end.receive(data)
            if end.has_output:
                peer.sendall(end.take_output())
    return received


async def test_pending_frames_are_sent_at_end(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "peer"))
        listener.listen()
        reading = asyncio.get_running_loop().run_in_executor(None, read_all, listener)
        async with processes(tmp_path, "a") as (here,):
            for number in range(20):
                here.transport.send(f"ipc://{tmp_path}/peer", bytes((number,)) * 200_000)
        assert await reading == [bytes((number,)) * 200_000 for number in range(20)]


async def test_unreading_peer_delays_end_half_second(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "peer"))
        listener.listen()
        here = Process(tmp_path / "a")
        here.transport.send(f"ipc://{tmp_path}/peer", b"x")
        began_s = time.monotonic()
        here.transport.close()
        assert time.monotonic() - began_s < 5
        assert not (tmp_path / "a").exists()


async def test_frames_to_absent_process_wait_bounded(tmp_path: Path) -> None:
    async with processes(tmp_path, "a") as (here,):
        nobody = f"ipc://{tmp_path}/nobody"
        taken = sum(here.transport.send(nobody, b"x") for _ in range(3 * QUEUE_LIMIT))
        assert taken == QUEUE_LIMIT
        assert here.transport.dropped == 2 * QUEUE_LIMIT
        large = f"ipc://{tmp_path}/another"
        taken = sum(here.transport.send(large, bytes(QUEUE_BYTES // 8)) for _ in range(20))
        assert taken == 8


async def test_late_process_gets_queue_urgent_first(tmp_path: Path) -> None:
    async with processes(tmp_path, "a") as (here,):
        for number in range(500):
            here.transport.send(f"ipc://{tmp_path}/b", b"%d" % number)
        here.transport.send(f"ipc://{tmp_path}/b", b"urgent", urgent=True)
        async with processes(tmp_path, "b") as (there,):
            received = [(await there.next())[0] for _ in range(501)]
        assert received == [b"urgent", *(b"%d" % number for number in range(500))]


async def test_urgent_frames_overtake_blocked_ones(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "peer"))
        listener.listen()
        async with processes(tmp_path, "a") as (here,):
            for number in range(10):
                here.transport.send(f"ipc://{tmp_path}/peer", bytes((number,)) * 500_000)
            here.transport.send(f"ipc://{tmp_path}/peer", b"urgent", urgent=True)
            reading = asyncio.get_running_loop().run_in_executor(None, read_all, listener)
            await until(lambda: not here.transport.waits)
        received = [data[:6] for data in await reading]
    assert received.index(b"urgent") <= 1
    assert [data[:1] for data in received if data != b"urgent"] == [bytes((n,)) for n in range(10)]


async def test_way_to_departed_process_is_reopened(tmp_path: Path) -> None:
    async with processes(tmp_path, "a") as (here,):
        async with processes(tmp_path, "b") as (there,):
            here.transport.send(there.address, b"1")
            here.transport.keep_only([])
            assert (await there.next())[0] == b"1"
            address = there.address
        here.transport.send(address, b"lost with it")
        await until(lambda: not here.transport.peers)
        async with processes(tmp_path, "b") as (there,):
            here.transport.send(address, b"2")
            assert (await there.next())[0] == b"2"


async def test_broken_connection_is_remade_for_queue(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "peer"))
        listener.listen()
        async with processes(tmp_path, "a") as (here,):
            here.transport.send(f"ipc://{tmp_path}/peer", b"1")
            first, _ = await asyncio.to_thread(listener.accept)
            first.close()
            reading = asyncio.get_running_loop().run_in_executor(None, read_all, listener)
            await until(lambda: not here.transport.waits)
        assert await reading == [b"1"]


@pytest.mark.parametrize(
    "sent",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        bytes(100),
        b"\xff" * 64,
        GREETING + b"\0\1x",
    ],
)
async def test_peer_of_foreign_protocol_is_disconnected(tmp_path: Path, sent: bytes) -> None:
    async with processes(tmp_path, "a") as (here,):
        reader, writer = await asyncio.open_unix_connection(tmp_path / "a")
        writer.write(sent)
        async with asyncio.timeout(PATIENCE_S):
            await reader.read()
        assert len(here.reasons) == 1
        writer.close()


async def test_a_peer_that_says_nothing_is_cut_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ipc_transport, "HANDSHAKE_S", 0.02)
    async with processes(tmp_path, "a") as (here,):
        reader, writer = await asyncio.open_unix_connection(tmp_path / "a")
        async with asyncio.timeout(PATIENCE_S):
            assert len(await reader.read()) == 64, "its greeting, and then the end"
        assert here.reasons == ["no READY within 0.02 s"]
        writer.close()


async def test_connections_beyond_limit_are_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ipc_transport, "CONNECTIONS_MAX", 1)
    async with processes(tmp_path, "a", "b") as (here, there):
        here.transport.send(there.address, b"1")
        assert (await there.next())[0] == b"1"
        reader, writer = await asyncio.open_unix_connection(tmp_path / "b")
        async with asyncio.timeout(PATIENCE_S):
            assert await reader.read() == b""
        assert there.reasons == ["more than 1 connections"]
        writer.close()
        here.transport.send(there.address, b"2")
        assert (await there.next())[0] == b"2"


async def test_connections_without_descriptor_wait_idle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ipc_transport, "ACCEPT_PAUSE_S", 0.02)
    async with processes(tmp_path, "a", "b") as (here, there):
        attempts = []

        class Full:
            """A listener of a process without a free descriptor, until the second attempt."""

            def __init__(self, listener: socket.socket) -> None:
                self._listener = listener
                self.fileno, self.close = listener.fileno, listener.close

            def accept(self) -> tuple[socket.socket, object]:
                attempts.append(1)
                if len(attempts) < 3:
                    raise OSError(errno.EMFILE, "Too many open files")
                return self._listener.accept()

        there.transport._listener = Full(there.transport._listener)  # type: ignore[assignment]
        here.transport.send(there.address, b"1")
        assert (await there.next())[0] == b"1"
        assert len(attempts) <= 5


async def test_exception_of_receiver_costs_no_other_message(tmp_path: Path) -> None:
    loop = asyncio.get_running_loop()
    failures: list[object] = []
    loop.set_exception_handler(lambda _, context: failures.append(context["exception"]))
    received: list[bytes] = []

    def on_data(data: bytes, connection: IpcConnection) -> None:
        received.append(data)
        if data == b"2":
            raise RuntimeError("a handler failed")

    there = IpcTransport(tmp_path / "b", on_data, lambda reason: None)
    async with processes(tmp_path, "a") as (here,):
        for number in range(5):
            here.transport.send(there.address, b"%d" % number)
        await until(lambda: len(received) == 5)
    there.close()
    assert received == [b"0", b"1", b"2", b"3", b"4"]
    assert [str(one) for one in failures] == ["a handler failed"]


async def test_a_burst_gives_the_event_loop_its_turn(tmp_path: Path) -> None:
    loop = asyncio.get_running_loop()
    turns = 0
    at: list[int] = []

    def count() -> None:
        nonlocal turns
        turns += 1
        loop.call_soon(count)

    there = IpcTransport(tmp_path / "b", lambda data, connection: at.append(turns), lambda reason: None)
    async with processes(tmp_path, "a") as (here,):
        for _ in range(1000):
            here.transport.send(there.address, b"x")
        count()
        await until(lambda: len(at) == 1000)
    there.close()
    assert max(at.count(turn) for turn in set(at)) <= 2 * ipc_transport.TURN


async def test_libzmq_talks_to_it_both_ways(tmp_path: Path) -> None:
    async with processes(tmp_path, "a") as (here,):
        with (
            zmq.Context() as context,
            context.socket(zmq.DEALER) as dealer,
            context.socket(zmq.ROUTER) as router,
        ):
            dealer.linger = router.linger = 0
            dealer.connect(here.address)
            dealer.send(b"question")
            dealer.send_multipart([b"two", b"parts"])
            dealer.send(bytes(100_000))
            data, back = await here.next()
            assert data == b"question"
            assert back.send(b"answer", urgent=False)
            assert await asyncio.to_thread(dealer.recv) == b"answer"
            assert (await here.next())[0] == bytes(100_000)
            assert here.reasons == ["a message of several parts"]
            router.bind(f"ipc://{tmp_path}/router")
            here.transport.send(f"ipc://{tmp_path}/router", b"to libzmq")
            identity, data = await asyncio.to_thread(router.recv_multipart)
            assert data == b"to libzmq"
            router.send_multipart([identity, b"back"])
            assert (await here.next())[0] == b"back"


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:1", "ipc://" + "x" * 300, "ipc://\0", "", "ipc://\ud800"]
)
async def test_invalid_address_costs_only_its_frames(tmp_path: Path, address: str) -> None:
    async with processes(tmp_path, "a", "b") as (here, there):
        here.transport.send(address, b"x")
        here.transport.send(there.address, b"1")
        assert (await there.next())[0] == b"1"
        here.transport.keep_only([there.address])
        assert list(here.transport.peers) == [there.address]


async def test_path_too_long_for_socket_says_so(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="shorter run_dir"):
        Process(tmp_path / ("x" * 107))
