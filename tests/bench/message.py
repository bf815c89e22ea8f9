"""A message from application to application of another node over both brokers, beside bare ZeroMQ with CURVE.

    python tests/bench/message.py [--messages N] [--json]

Four processes: application, broker, broker, application. The message goes over ipc, from broker to broker,
and over ipc; it is stamped with the monotonic clock, which all share, when it is sent and when it is in the
inbox. Between the brokers a message of 200 B is a datagram, sealed with keys from the same key pairs as CURVE
(ADR 49), and one of 2 kB takes the connection with CURVE. The bare pair is two processes on uvloop with one
CURVE connection, the middle one of the three hops, and messages of the same size. The rounds alternate, so
that the load of the machine affects all. A ratio is refused if its bare figure is more than 20 % above the
best of three that are taken at the start.
"""

import argparse
import asyncio
import json
import socket
import statistics
import sys
import tempfile
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from time import monotonic_ns

import uvloop
import zmq
from rows import AT_START, REFUSED, Bare

from swarmd.broker.config import Config
from swarmware.module.module import Module
from swarmware.testing.process import Process, run_python, spawn
from swarmware.testing.tmpnode import make_node
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.root import make_swarm
from swarmware.types.scalar import Blob

ROUNDS = 5
PAYLOADS_BYTES = (200, 2000)
"""A payload that fits a datagram, and a payload that does not."""
MEASURED_S = 2.5
"""Time after which the brokers have measured the loss of their link."""
BUDGET_US = 500.0
"""Message app → broker → broker → app, p50, on one machine with CURVE."""
STAMP = 8


class BareEnd:
    """One end of a bare CURVE connection on the event loop, drained by its descriptor."""

    def __init__(self, socket_: "zmq.Socket[bytes]") -> None:
        self.socket = socket_
        self.came = asyncio.Event()
        self.got: list[list[bytes]] = []
        asyncio.get_running_loop().add_reader(int(socket_.getsockopt(zmq.FD)), self.drain)

    def drain(self) -> None:
        """Receives all waiting messages."""
        while True:
            try:
                self.got.append(self.socket.recv_multipart(zmq.NOBLOCK))
            except zmq.Again:
                break
        if self.got:
            self.came.set()

    async def receive(self) -> list[bytes]:
        """The next message."""
        while not self.got:
            self.came.clear()
            self.drain()
            if not self.got:
                await self.came.wait()
        return self.got.pop(0)

    def send(self, parts: list[bytes]) -> None:
        """Sends a message, then receives those that arrived meanwhile."""
        self.socket.send_multipart(parts)
        self.drain()


def curve(context: "zmq.Context[zmq.Socket[bytes]]", kind: int, keys: Keys, server: bytes | None) -> BareEnd:
    """A socket with CURVE; with a server's key it is the client."""
    made = context.socket(kind)
    made.setsockopt(zmq.LINGER, 0)
    if server is None:
        made.setsockopt(zmq.CURVE_SERVER, 1)
    else:
        made.setsockopt(zmq.CURVE_SERVERKEY, server)
        made.setsockopt(zmq.CURVE_PUBLICKEY, keys.curve_public)
    made.setsockopt(zmq.CURVE_SECRETKEY, keys.curve_secret)
    return BareEnd(made)


async def serve_bare(folder: Path) -> None:
    """The other end of the bare pair: sends each message back with its own stamp in front."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    end = curve(context, zmq.ROUTER, Keys.load(folder, "uav2"), None)
    port = end.socket.bind_to_random_port("tcp://127.0.0.1")
    print(port, flush=True)
    while True:
        identity, data = await end.receive()
        end.send([identity, monotonic_ns().to_bytes(STAMP, "little") + data])


async def serve_inbox(config_dir: Path) -> None:
    """The receiving application: reads its inbox for ever."""
    async with Module("receiver", config_dir=config_dir) as module:
        box = module.inbox("bench/message", Blob)
        print("ready", flush=True)
        async for _ in box:
            pass


class Bench:
    """Both paths, ready to be measured."""

    def __init__(self, module: Module, bare: BareEnd) -> None:
        self._module = module
        self._bare = bare

    async def over_brokers_us(self, count: int, size: int) -> list[float]:
        """One way, from the call to the receiver's inbox."""
        out: list[float] = []
        for _ in range(count):
            sent_ns = self._module.now_ns()
            outcome = await self._module.send("/uav2/bench/message", Blob(bytes(size)), timeout_s=10)
            if not outcome.delivered:
                raise SystemExit(f"not delivered: {outcome}")
            out.append((outcome.received_ns - sent_ns) / 1000)
        return out

    async def bare_us(self, count: int, size: int) -> list[float]:
        """One way over the bare connection."""
        out: list[float] = []
        for _ in range(count):
            sent_ns = monotonic_ns()
            self._bare.send([bytes(size)])
            [data] = await self._bare.receive()
            out.append((int.from_bytes(data[:STAMP], "little") - sent_ns) / 1000)
        return out


@asynccontextmanager
async def open_bench(root: Path) -> AsyncIterator[Bench]:
    """Two nodes with their brokers, an application on each, and the bare pair."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    make_swarm(root / "keys", dict.fromkeys(["uav1", "uav2"], "operator"))
    config = Config(udp_port=port, bind_address="127.0.0.1")
    folders = [
        make_node(root, name, services={"broker": config}, keys_dir=str(root / "keys" / name))
        for name in ("uav1", "uav2")
    ]
    async with AsyncExitStack() as stack:
        for folder in folders:
            await stack.enter_async_context(spawn(folder, "broker"))

        async def other(what: str, where: Path) -> tuple[Process, str]:
            process = await stack.enter_async_context(run_python(__file__, "--serve", what, str(where)))
            return process, await process.line()

        await other("inbox", folders[1])
        _, port_text = await other("bare", root / "keys" / "uav2")
        module = await stack.enter_async_context(Module("sender", config_dir=folders[0]))
        keys = Keys.load(root / "keys" / "uav1", "uav1")
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        stack.callback(context.destroy, 0)
        bare = curve(context, zmq.DEALER, keys, keys.curve_of("uav2"))
        bare.socket.connect(f"tcp://127.0.0.1:{port_text}")
        bench = Bench(module, bare)
        while not await module.send("/uav2/bench/message", Blob(b""), timeout_s=1):
            pass  # the brokers have not met yet
        until_ns = monotonic_ns() + round(MEASURED_S * 1e9)
        while monotonic_ns() < until_ns:
            for size in PAYLOADS_BYTES:
                await bench.bare_us(25, size)
                await bench.over_brokers_us(25, size)
        yield bench


def quantiles(times_us: list[float]) -> dict[str, float]:
    """p50, p99 and maximum."""
    ordered = sorted(times_us)
    return {
        "p50": round(statistics.median(ordered), 1),
        "p99": round(ordered[int(0.99 * (len(ordered) - 1))], 1),
        "max": round(ordered[-1], 1),
    }


Figures = dict[str, dict[str, float] | str]
"""By path and quantile; and why the ratio is refused, or empty if it counts."""


async def measure(messages: int) -> dict[int, Figures]:
    """Both paths in turns, by bytes of the message."""
    ours: dict[int, list[float]] = {size: [] for size in PAYLOADS_BYTES}
    bare: dict[int, list[float]] = {size: [] for size in PAYLOADS_BYTES}
    with tempfile.TemporaryDirectory(prefix="sw") as folder:
        async with open_bench(Path(folder)) as bench:
            at_start: dict[int, list[float]] = {size: [] for size in PAYLOADS_BYTES}
            for _ in range(AT_START):
                for size in PAYLOADS_BYTES:
                    at_start[size].append(statistics.median(await bench.bare_us(messages // ROUNDS, size)))
            for _ in range(ROUNDS):
                for size in PAYLOADS_BYTES:
                    ours[size] += await bench.over_brokers_us(messages // ROUNDS, size)
                    bare[size] += await bench.bare_us(messages // ROUNDS, size)
    return {
        size: {
            "app_broker_broker_app_us": quantiles(ours[size]),
            "zeromq_curve_tcp_us": quantiles(bare[size]),
            "refusal": Bare(at_start[size]).refusal(statistics.median(bare[size])),
        }
        for size in PAYLOADS_BYTES
    }


def main() -> int:
    """Measures and prints; not 0 when a ratio is refused."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--messages", type=int, default=2000)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--serve", nargs=2, metavar=("WHAT", "WHERE"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        if options.serve is not None:
            what, where = options.serve
            runner.run({"inbox": serve_inbox, "bare": serve_bare}[what](Path(where)))
            return 0
        figures = runner.run(measure(options.messages))
    if options.json:
        print(json.dumps(figures))
    else:
        print_table(figures)
    return REFUSED if any(found["refusal"] for found in figures.values()) else 0


def print_table(figures: dict[int, Figures]) -> None:
    """Both paths and their ratio, by bytes of the message."""
    for size, found in figures.items():
        ours, bare = found["app_broker_broker_app_us"], found["zeromq_curve_tcp_us"]
        assert isinstance(ours, dict)
        assert isinstance(bare, dict)
        print(f"{f'{size} B, one way, in µs':32} {'p50':>8} {'p99':>8} {'max':>8}")
        for name, row in (("app → broker → broker → app", ours), ("bare ZeroMQ, TCP, CURVE", bare)):
            print(f"{name:32} {row['p50']:8.1f} {row['p99']:8.1f} {row['max']:8.1f}")
        refused = f"; REFUSED: {found['refusal']}" if found["refusal"] else ""
        print(f"ratio {ours['p50'] / bare['p50']:.2f}; budget {BUDGET_US:.0f} µs p50{refused}")


if __name__ == "__main__":
    sys.exit(main())
