"""Shared memory: a board read, and one frame from process to process beside ZeroMQ and Zenoh in one run.

    python tests/bench/shm.py [--messages N]

One way: two processes exchange one message in turn. Each stamps it at sending with the monotonic clock, which
both share, and the other computes the difference at reception. Services use uvloop, so compare that row;
Zenoh's callback thread without a loop is its best case. The rounds of the peers alternate, so that the load
of the machine affects all. A table is refused if the figure of its bare FIFO is more than 20 % above the
best of three that are taken at the start. On two idle cores the wake-up of the other process dominates: the
bare FIFO is the lower bound of every transport whose receiver sleeps.
"""

import argparse
import contextlib
import json
import multiprocessing
import os
import socket
import statistics
import struct
import sys
import tempfile
import threading
import timeit
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from time import monotonic_ns
from typing import Any, Protocol

import uvloop
import zmq
from rows import REFUSED, Bare

from swarmware.model import frame as wire
from swarmware.model.frame import Frame, FrameKind
from swarmware.model.names import ANY
from swarmware.transport.shm.doorbell import Doorbell, DoorbellSenders
from swarmware.transport.shm.layout import readers_folder
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.ring import RingReader, RingWriter
from swarmware.types import registry
from swarmware.types.vehicle import Pose

ROUNDS = 5
HEAD = struct.Struct("<QQ")
"""When it was sent; how long the one before it took to its sender, both in ns."""
STOP = (1 << 64) - 1
CAMERA_BYTES = 8 << 20

OnMessage = Callable[[memoryview], None]
Cores = tuple[set[int], set[int]]
"""Cores on which the two processes run."""


class End(Protocol):
    """One end of a two-way path between two processes."""

    def run(self, on_message: OnMessage, first: Callable[[], None]) -> None:
        """Serve until `stop`; `first` is called when everything is ready."""

    def send(self, data: bytearray) -> None: ...

    def stop(self) -> None: ...


class RingEnd:
    """Two rings and two doorbells; in a uvloop, or blocking on the bell."""

    def __init__(self, folder: Path, side: int, size: int, *, looped: bool, loaned: bool) -> None:
        self.folder = folder
        self.side = side
        self.looped = looped
        self.loaned = loaned
        self.doorbells = DoorbellSenders(folder / "bells")
        mine, self.theirs = folder / f"{side}.ring", folder / f"{1 - side}.ring"
        self.writer = RingWriter(mine, slots=4, slot_bytes=size)
        self.bells = ReaderNotifier(readers_folder(mine), self.doorbells)
        self.doorbell = Doorbell(folder / "bells")
        with ReaderNotifier(readers_folder(self.theirs), self.doorbells) as bells:
            bells.add(self.doorbell.name)
        self.reader: RingReader | None = None
        self.running = True
        self.size = size

    def run(self, on_message: OnMessage, first: Callable[[], None]) -> None:
        self.on_message = on_message
        if not self.looped:
            first()
            while self.running:
                self.doorbell.wait(10)
                self.look()
            return
        self.loop = uvloop.new_event_loop()
        self.loop.add_reader(self.doorbell.fd, self.ring)
        self.loop.call_soon(first)
        self.loop.run_forever()
        self.loop.close()

    def ring(self) -> None:
        self.doorbell.drain()
        self.look()

    def look(self) -> None:
        if self.reader is None:
            self.reader = RingReader(self.theirs, after=0)
        if self.loaned:
            while (view := self.reader.next_view()) is not None:
                self.on_message(view.data)
                assert view.still_valid()
                view.release()
        else:
            while (data := self.reader.next()) is not None:
                self.on_message(memoryview(data))

    def send(self, data: bytearray) -> None:
        if self.loaned:
            self.writer.loan(self.size)[: HEAD.size] = data[: HEAD.size]  # the camera writes the rest
            self.writer.publish()
        else:
            self.writer.write(data)
        self.bells.notify()

    def stop(self) -> None:
        self.running = False
        if self.looped:
            self.loop.stop()


class PipeEnd:
    """Two bare pipes, blocking: the kernel's time to wake the other process, the lower bound of all
    transports."""

    def __init__(self, folder: Path, side: int) -> None:
        for name in ("0.fifo", "1.fifo"):
            with contextlib.suppress(FileExistsError):
                os.mkfifo(folder / name)
        self.mine, self.theirs = (os.open(folder / f"{n}.fifo", os.O_RDWR) for n in (side, 1 - side))
        self.running = True

    def run(self, on_message: OnMessage, first: Callable[[], None]) -> None:
        first()
        while self.running:
            on_message(memoryview(os.read(self.theirs, 1 << 16)))

    def send(self, data: bytearray) -> None:
        os.write(self.mine, data)

    def stop(self) -> None:
        self.running = False


class ZmqEnd:
    """PAIR over ipc: its edge-triggered descriptor in a uvloop, drained with NOBLOCK and after every send."""

    def __init__(self, folder: Path, side: int) -> None:
        self.context = zmq.Context()
        self.socket = self.context.socket(zmq.PAIR)
        self.socket.linger = 0
        (self.socket.connect if side else self.socket.bind)(f"ipc://{folder}/pair")

    def run(self, on_message: OnMessage, first: Callable[[], None]) -> None:
        self.on_message = on_message
        self.loop = uvloop.new_event_loop()
        self.loop.add_reader(self.socket.getsockopt(zmq.FD), self.drain)
        self.loop.call_soon(first)
        self.loop.run_forever()
        self.loop.close()
        self.socket.close()
        self.context.term()

    def drain(self) -> None:
        try:
            while True:
                self.on_message(memoryview(self.socket.recv(zmq.NOBLOCK)))
        except zmq.Again:
            return

    def send(self, data: bytearray) -> None:
        self.socket.send(data, zmq.NOBLOCK)
        events: Any = self.socket.getsockopt(zmq.EVENTS)
        if events & zmq.POLLIN:
            self.loop.call_soon(self.drain)

    def stop(self) -> None:
        self.loop.call_later(0.05, self.loop.stop)  # the last message leaves by a thread of libzmq


class ZenohEnd:
    """Two peers that know each other's address; handed into a uvloop, or answered in Zenoh's own thread.

    Over TCP: with its shared memory, which it leaves files of behind, 1 KB takes 5 to 15 % longer.
    """

    def __init__(self, folder: Path, side: int, *, looped: bool) -> None:
        import zenoh

        config: Any = zenoh.Config()
        address = json.dumps([f"tcp/127.0.0.1:{(folder / 'port').read_text()}"])
        config.insert_json5("mode", '"peer"')
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("scouting/gossip/enabled", "false")
        config.insert_json5("listen/endpoints", "[]" if side else address)
        config.insert_json5("connect/endpoints", address if side else "[]")
        config.insert_json5("transport/shared_memory/enabled", "false")
        self.session: Any = zenoh.open(config)
        self.publisher: Any = self.session.declare_publisher(f"bench/{side}")
        self.theirs = f"bench/{1 - side}"
        self.done = threading.Event()
        self.loop = uvloop.new_event_loop() if looped else None

    def run(self, on_message: OnMessage, first: Callable[[], None]) -> None:
        matched = threading.Event()
        if (loop := self.loop) is not None:

            def receive(sample: Any) -> None:
                loop.call_soon_threadsafe(on_message, memoryview(sample.payload.to_bytes()))
        else:

            def receive(sample: Any) -> None:
                on_message(memoryview(sample.payload.to_bytes()))

        listener: Any = self.publisher.declare_matching_listener(lambda _status: matched.set())
        subscriber: Any = self.session.declare_subscriber(self.theirs, receive)
        if self.publisher.matching_status.matching:
            matched.set()
        matched.wait(10)
        if loop is None:
            first()
            self.done.wait(60)
        else:
            loop.call_soon(first)
            loop.run_forever()
            loop.close()
        subscriber.undeclare()
        listener.undeclare()
        self.session.close()

    def send(self, data: bytearray) -> None:
        self.publisher.put(data)

    def stop(self) -> None:
        self.done.set()
        if self.loop is not None:
            self.loop.stop()


FIFO = "bare FIFO, blocking"
PEERS: dict[str, Callable[[Path, int], End]] = {
    "ring, uvloop": lambda folder, side: RingEnd(folder, side, 1024, looped=True, loaned=False),
    FIFO: PipeEnd,
    "ring, blocking": lambda folder, side: RingEnd(folder, side, 1024, looped=False, loaned=False),
    "ZeroMQ PAIR ipc, uvloop": ZmqEnd,
    "Zenoh, uvloop": lambda folder, side: ZenohEnd(folder, side, looped=True),
    "Zenoh, callback thread": lambda folder, side: ZenohEnd(folder, side, looped=False),
}
CAMERA: dict[str, Callable[[Path, int], End]] = {
    "ring, uvloop, loan + view": lambda folder, side: RingEnd(
        folder, side, CAMERA_BYTES, looped=True, loaned=True
    ),
    "ring, uvloop, copied": lambda folder, side: RingEnd(
        folder, side, CAMERA_BYTES, looped=True, loaned=False
    ),
}


def play(
    make: Callable[[Path, int], End],
    folder: Path,
    side: int,
    size: int,
    count: int,
    cores: Cores,
    out: Connection,
) -> None:
    """One process of two; side 0 answers, side 1 asks and reports what both measured, in ns."""
    os.sched_setaffinity(0, cores[side])
    end = make(folder, side)
    taken: list[int] = []
    message = bytearray(size)
    left = count

    def send(last_ns: int) -> None:
        HEAD.pack_into(message, 0, monotonic_ns(), last_ns)
        end.send(message)

    def on_message(data: memoryview) -> None:
        nonlocal left
        now = monotonic_ns()
        sent_ns, last_ns = HEAD.unpack_from(data)
        if last_ns == STOP:
            end.stop()
            return
        taken.append(now - sent_ns)
        if side == 0:
            send(now - sent_ns)
            return
        taken.append(last_ns)
        left -= 1
        if left:
            send(0)
        else:
            send(STOP)
            end.stop()

    def first() -> None:
        if side:
            send(0)

    if side == 0:
        out.send([])
    end.run(on_message, first)
    if side:
        out.send(taken[len(taken) // 10 :])  # without the first tenth: caches, connections, first calls


def measure(make: Callable[[Path, int], End], size: int, count: int, cores: Cores) -> list[int]:
    """One round between two fresh processes."""
    context = multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory(dir="/dev/shm") as name, socket.socket() as free:
        folder = Path(name)
        free.bind(("127.0.0.1", 0))
        (folder / "port").write_text(str(free.getsockname()[1]))
        free.close()
        processes = []
        taken: list[int] = []
        with contextlib.suppress(EOFError):  # it could not start: its traceback is on stderr
            for side in (0, 1):
                ours, theirs = context.Pipe()
                process = context.Process(target=play, args=(make, folder, side, size, count, cores, theirs))
                processes.append(process)
                process.start()
                theirs.close()
                if ours.poll(60):
                    taken = ours.recv()  # nothing yet from the answering side: it is ready
        for process in reversed(processes):
            process.join(10)
            process.kill()
            process.join()
        return taken


def bare_us(count: int, cores: Cores) -> Bare:
    """The bare FIFO at the start of the run."""
    return Bare.measured(lambda: statistics.median(measure(PipeEnd, 1024, count, cores)) / 1000)


def compare(
    peers: dict[str, Callable[[Path, int], End]], size: int, count: int, where: str, cores: Cores, bare: Bare
) -> None:
    """All peers and the bare FIFO in turn, several rounds; prints the table with the first peer as the
    measure, or that its ratios are refused."""
    taken: dict[str, list[int]] = {name: [] for name in peers}
    peers = dict(peers)
    beside: list[int] = []
    for _ in range(ROUNDS):
        beside += measure(PipeEnd, 1024, count, cores)
        for name in [*peers]:
            values = measure(peers[name], size, count, cores)
            taken[name] += values
            if not values:
                del peers[name]  # what does not run once is not tried again
    print(f"{f'one way, {size} bytes, {where}':<38}{'p50 µs':>10}{'p99 µs':>10}{'p50 ratio':>11}")
    measure_us = 0.0
    for name, values in taken.items():
        if not values:
            print(f"{name:<38}{'does not run here':>31}")
            continue
        values.sort()
        p50_us, p99_us = (values[int(len(values) * share)] / 1000 for share in (0.5, 0.99))
        measure_us = measure_us or p50_us
        print(f"{name:<38}{p50_us:>10.1f}{p99_us:>10.1f}{p50_us / measure_us:>10.1f}x")
    if refusal := bare.refusal(statistics.median(beside) / 1000):
        print(f"REFUSED: {refusal}")


def board() -> None:
    """Time of a board read, compared with reading one field of an object in the same process."""
    pose = Pose(1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.1, 0.2, 0.3, 0.01)
    payload = registry.encode(pose)
    data = wire.encode(Frame(FrameKind.BOARD, 1, 2, 3, ANY, ANY, sequence=1, stamp_ns=1, payload=payload))
    with tempfile.TemporaryDirectory(dir="/dev/shm") as name:
        path = Path(name) / "nav.pose.ring"
        with RingWriter(path, slots=4, slot_bytes=256) as writer, RingReader(path) as reader:
            padded = data + bytes(200 - len(data))
            writer.write(padded)
            reader.newest()

            def unchanged() -> bool:
                return reader.sequence == reader.seen

            def changed() -> Pose:
                newest = reader.newest()
                assert newest is not None
                frame = wire.decode(newest)
                return registry.decode(Pose, frame.payload, frame.codec)

            rows = {
                "board, unchanged": unchanged,
                "board, newest frame of 200 bytes": reader.newest,
                "board, changed and decoded to Pose": changed,
                "write of 200 bytes": lambda: writer.write(padded),
            }
            print(f"{'one call':<40}{'µs':>8}")
            for label, call in rows.items():
                if label.startswith("board, changed"):
                    writer.write(data)
                best = min(timeit.repeat(call, number=20_000, repeat=7)) / 20_000
                print(f"{label:<40}{best * 1e6:>8.2f}")


def main() -> int:
    """Prints the tables; not 0 when one is refused."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--messages", type=int, default=3000, help="per round and peer")
    options = parser.parse_args()
    every = os.sched_getaffinity(0)
    one, other = min(every), max(every)
    places: dict[str, Cores] = {
        "one core": ({one}, {one}),
        "two cores": ({one}, {other}),
        "any core": (every, every),
    }
    bare = {where: bare_us(options.messages, cores) for where, cores in places.items()}
    board()
    print()
    for where, cores in places.items():
        compare(PEERS, 1024, options.messages, where, cores, bare[where])
        print()
    count = max(options.messages // 30, 20)
    compare(CAMERA, CAMERA_BYTES, count, "one core", places["one core"], bare["one core"])
    return REFUSED if any(one.refused for one in bare.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
