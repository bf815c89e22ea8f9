"""Processor time of a broker for one beacon, compared with the bare reception of the same bytes.

    python tests/bench/beacons.py [--seconds N] [--json]

One real broker on its own loopback group; the fifteen neighbours are real broker cores in virtual time, all
in range of each other, each with a pose at 10 Hz and a mission state that changes every second. Each beacon
is signed. Bare:
`recvmsg` with the kernel's timestamp and one `struct.unpack` of the clear header, of the same datagrams.
Together: one of three datagrams received in a batch. Hot: one datagram after the other. Cold: the processor's
caches are overwritten before each, as by the other nodes when sixteen share two cores. A ratio is refused if
its bare figure is more than 20 % above the best of three that are taken at the start.
"""

import argparse
import gc
import json
import socket
import statistics
import struct
import sys
import tempfile
import time
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np
import uvloop
from rows import REFUSED, Bare

from swarmd.broker.config import Config
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Beacon, Header, PlatformCode
from swarmd.broker.core.beacon.hello_schedule import NodeIdentity
from swarmd.broker.core.beacon.parts.beacon_signature import PART_BYTES
from swarmd.broker.core.beacon_protocol import BeaconProtocol
from swarmd.broker.core.membership.sessions import Sessions
from swarmd.broker.core.membership.signatures.own_signatures import OwnSignatures
from swarmd.broker.core.swarm.topology import Topology
from swarmd.broker.core.traffic import Counters
from swarmd.broker.records.session_store import SessionStore
from swarmd.broker.service import Broker, BrokerShell
from swarmware.model.clock import Clock
from swarmware.model.names import data_id, hardware_id
from swarmware.module.module import Module
from swarmware.node.node import Node
from swarmware.testing.tmpnode import make_node
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.root import make_swarm
from swarmware.transport.security.seal import Opened, Opener, Sealer
from swarmware.types.mission import MissionPhase, MissionState
from swarmware.types.net import BoardPublication, BoardSubscription, TreePlan
from swarmware.types.registry import pack
from swarmware.types.vehicle import Pose

NEIGHBOURS: Final = 15
TOGETHER: Final = 7
"""Datagrams in a cell of sixteen that come within `udp.WINDOW_NS`."""
ME: Final = "uav16"
GROUP: Final = "239.83.87.16"
LOOPBACK: Final = "127.0.0.1"
SECOND: Final = 1_000_000_000
PERIOD: Final = SECOND // 10
WARM_BEACONS: Final = 100
CACHES_BYTES: Final = 96 << 20
"""Three times the last level of the largest cache seen."""
POSE: Final = data_id("nav/pose", "Pose")
STATE: Final = data_id("mission/state", "MissionState")
OFFERS: Final = (
    BoardPublication("nav/pose", POSE, "Pose"),
    BoardPublication("mission/state", STATE, "MissionState"),
)
_STAMP: Final = 35
_HEADER: Final = struct.Struct("<BBIII")


class Instant(Clock):
    """A clock that shows a set instant."""

    __slots__ = ("at_ns",)

    def __init__(self) -> None:
        super().__init__(boot_id=1)
        self.at_ns = 100 * SECOND

    def now_ns(self) -> int:
        return self.at_ns

    def from_mono_ns(self, mono_ns: int) -> int:
        return self.at_ns


class LinkPeer:
    """A neighbour, which sends the datagrams of a real broker."""

    def __init__(self, name: str, others: list[str], keys: Keys) -> None:
        self.hw = hardware_id(name)
        self.protocol = BeaconProtocol(
            NodeIdentity(self.hw, name, "main", PlatformCode.UAV, 1, b""),
            Topology(self.hw, 1, SECOND, 0),
            Counters(),
            Config(),
        )
        self.protocol.set_plan(TreePlan(1, OFFERS, wants(others)))
        self.sessions = Sessions(self.hw, 1, connections=False)
        self.protocol.reserved_bytes = PART_BYTES
        self.signatures = OwnSignatures(self.hw, 1, keys)
        self.sealer = Sealer(keys.group, self.hw, 1)

    def compose(self, now_ns: int, turn: int) -> tuple[Header, Beacon, bytes]:
        """Next datagram of the node, clear and sealed."""
        protocol = self.protocol
        protocol.advance(now_ns)
        boards = protocol.published.boards
        boards[POSE].put(Pose.planar(turn / 10, self.hw % 100, 0.1 * turn).pack(), True, now_ns - 3_000_000)
        if turn % 10 == 0:
            state = MissionState(
                turn, "01234567", MissionPhase.RUNNING, ("goto",), progress_ratio=turn % 100 / 100
            )
            boards[STATE].put(pack(state)[0], True, now_ns - 5_000_000)
        outgoing = protocol.compose(now_ns)
        beacon = msgspec.structs.replace(outgoing.beacon, checks=self.sessions.due(now_ns))
        header = Header(
            0,
            self.hw,
            outgoing.sequence,
            now_ns // 1000 & 0xFFFF_FFFF,
            1 if outgoing.with_session else None,
        )
        clear = codec.encode_header(header)
        body = self.signatures.signed(clear, codec.encode(beacon), beacon.values, now_ns // 1000)
        data = clear + self.sealer.seal(header.sequence, clear, body)
        protocol.sent(header.sequence, now_ns, len(data))
        return header, beacon, data


class Costs(NamedTuple):
    """Microseconds of one datagram or beacon."""

    received_us: float
    bare_us: float
    together_us: float
    sent_us: float
    bytes: float
    refusal: str = ""
    """Why the ratio is refused, or empty if it counts."""

    @property
    def ratio(self) -> float:
        """Reception over bare reception."""
        return self.received_us / self.bare_us


class Cell:
    """The broker and its neighbours."""

    def __init__(self, broker: BrokerShell, clock: Instant, config: Config, keys: dict[str, Keys]) -> None:
        """`keys`: of each member."""
        self.broker = broker
        self.clock = clock
        names = [name for name in keys if name != ME]
        self.peers = [LinkPeer(name, [*(o for o in names if o != name), ME], keys[name]) for name in names]
        self.opener = Opener(keys[ME].group)
        self.me = hardware_id(ME)
        broker._driver.feed(broker._core.on_plan(TreePlan(1, OFFERS, wants(names)), clock.at_ns))
        self.udp = broker._transport._udp
        self.group = (GROUP, config.udp_port)
        self.out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.out.bind((LOOPBACK, 0))
        self.out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(LOOPBACK))
        self.said: list[bytes] = []
        self.udp.send_to_all = self._heard  # type: ignore[method-assign]  # not back to our own socket
        assert self.udp._all is not None
        self.bare = self.udp._all.dup()
        self.turn = 0
        self.flushed = np.zeros(CACHES_BYTES // 8)

    def _heard(self, data: bytes) -> bool:
        self.said.append(data)
        return True

    def flush(self) -> None:
        """Overwrites the processor's caches."""
        self.flushed += 1.0

    def run(self, beacons: int, *, cold: bool) -> Costs:
        """Times reception and sending of a number of beacons of each node."""
        received: list[int] = []
        bare: list[int] = []
        together: list[int] = []
        sent: list[int] = []
        sizes: list[int] = []
        for _ in range(beacons):
            self.turn += 1
            start_ns = self.clock.at_ns
            sent.append(self._send(cold))
            datagrams = self._compose(start_ns)
            sizes += map(len, datagrams)
            for index, data in enumerate(datagrams):
                self.clock.at_ns = start_ns + (index + 1) * PERIOD // (NEIGHBOURS + 1)
                if self.turn % 2:
                    received.append(self._receive([data], cold))
                    bare.append(self._receive_bare(data, cold))
                elif (index + 1) % TOGETHER == 0:
                    several = datagrams[index + 1 - TOGETHER : index + 1]
                    together.append(self._receive(several, cold) // TOGETHER)
            self.clock.at_ns = start_ns + PERIOD
        return Costs(
            quick_us(received),
            quick_us(bare),
            quick_us(together),
            quick_us(sent),
            statistics.mean(sizes),
        )

    def _compose(self, start_ns: int) -> list[bytes]:
        out: list[bytes] = []
        for index, peer in enumerate(self.peers):
            now_ns = start_ns + (index + 1) * PERIOD // (NEIGHBOURS + 1)
            header, beacon, data = peer.compose(now_ns, self.turn)
            out.append(data)
            for other in self.peers:
                if other is not peer:
                    other.protocol.on_beacon(header, beacon, (LOOPBACK, 1), now_ns)
        return out

    def _send(self, cold: bool) -> int:
        for board in self.broker._core.published.boards.values():
            if board.data_id == POSE or self.turn % 10 == 0:
                board.put(Pose.planar(self.turn / 10, 0.0).pack(), True, self.clock.at_ns)
        self.said.clear()
        if cold:
            self.flush()
        began = time.perf_counter_ns()
        step(self.broker)
        took = time.perf_counter_ns() - began
        for data in self.said:
            header, start = codec.decode_header(data)
            opened = self.opener.open(
                0, header.sender_hw, header.session, header.sequence, data[:start], data[start:]
            )
            assert isinstance(opened, Opened)
            beacon = codec.decode(opened.body)
            for peer in self.peers:
                peer.sessions.on_datagram(header.sender_hw, opened.session, beacon.checks, self.clock.at_ns)
                peer.protocol.on_beacon(header, beacon, (LOOPBACK, 1), self.clock.at_ns)
        return took

    def _receive(self, datagrams: list[bytes], cold: bool) -> int:
        for data in datagrams:
            self.out.sendto(data, self.group)
        if cold:
            self.flush()
        began = time.perf_counter_ns()
        drain(self.broker)
        return time.perf_counter_ns() - began

    def _receive_bare(self, data: bytes, cold: bool) -> int:
        self.out.sendto(data, self.group)
        receive, unpack = self.bare.recvmsg, _HEADER.unpack_from
        if cold:
            self.flush()
        began = time.perf_counter_ns()
        unpack(receive(2048, 32)[0])
        return time.perf_counter_ns() - began


def quick_us(took_ns: list[int]) -> float:
    """Mean of the fastest tenth, which excludes the load by other processes of this machine."""
    return statistics.quantiles(took_ns, n=10)[0] / 1000


def wants(names: list[str]) -> tuple[BoardSubscription, ...]:
    """Pose and mission state of each node."""
    return tuple(
        BoardSubscription(name, offer.path, offer.type, offer.data_id) for name in names for offer in OFFERS
    )


def step(broker: BrokerShell) -> None:
    """What the broker does at its beacon."""
    broker._core._schedule.due_ns = broker._clock.now_ns()
    broker._core._tables_changed = False
    broker._driver.feed(broker.on_timer(broker._clock.now_ns()))


def drain(broker: BrokerShell) -> None:
    """What the event loop does when a socket has something."""
    broker._transport.receive()


async def measure(folder: Path, beacons: int) -> dict[str, Costs]:
    """Both states of the caches."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((LOOPBACK, 0))
        port = free.getsockname()[1]
    config = Config(multicast_group=GROUP, multicast_interface=LOOPBACK, udp_port=port, bind_address=LOOPBACK)
    names, keys_dir = [ME, *(f"uav{index + 1}" for index in range(NEIGHBOURS))], folder / "keys"
    make_swarm(keys_dir, names)
    node = Node.attach(make_node(folder, ME, keys_dir=str(keys_dir / ME)))
    clock = node.clock = Instant()
    async with AsyncExitStack() as stack:
        stack.callback(node.close)
        module = await stack.enter_async_context(Module("broker", node=node))
        service = Broker(module, config)
        keys = service._keys()
        session_store = SessionStore(module.node.config.data_path)
        core = service._core(config, keys, session_store)
        core._publish_ns = 1 << 62  # tables are not what is measured
        broker = BrokerShell(service, config, keys, core, session_store)
        broker._driver._arm = lambda: None  # type: ignore[method-assign]  # this program steps it
        cell = Cell(broker, clock, config, {name: Keys.load(keys_dir / name, name) for name in names})
        cell.run(WARM_BEACONS, cold=False)
        gc.collect()
        gc.disable()
        refused = core.counters.refused_table()
        few = max(beacons // 10, 4)
        bare_hot = Bare.measured(lambda: cell.run(few, cold=False).bare_us)
        bare_cold = Bare.measured(lambda: cell.run(few, cold=True).bare_us)
        hot, cold = cell.run(beacons, cold=False), cell.run(few, cold=True)
        found = {
            "hot": hot._replace(refusal=bare_hot.refusal(hot.bare_us)),
            "cold": cold._replace(refusal=bare_cold.refusal(cold.bare_us)),
        }
        assert core.counters.refused_table() == refused, "a datagram was refused"
        assert sum(neighbour.state.name == "UP" for neighbour in core._neighbours.all()) == 15
        cell.bare.close()
        cell.out.close()
        broker.close()
        return found


def main() -> int:
    """Prints the table; not 0 when a ratio is refused."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=int, default=40, help="of virtual time")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        found = uvloop.run(measure(Path(scratch), arguments.seconds * 10))
    if arguments.json:
        table = {state: {**costs._asdict(), "ratio": costs.ratio} for state, costs in found.items()}
        print(json.dumps(table))
    else:
        print_table(found)
    return REFUSED if any(costs.refusal for costs in found.values()) else 0


def print_table(found: dict[str, Costs]) -> None:
    """A line for each state of the caches."""
    print(f"{NEIGHBOURS} neighbours at 10 Hz, {found['hot'].bytes:.0f} bytes a datagram; µs, fastest tenth")
    print(f"{'caches':<8}{'received':>10}{'bare':>8}{'ratio':>8}{'together':>10}{'beacon sent':>13}")
    for state, costs in found.items():
        print(
            f"{state:<8}{costs.received_us:>10.1f}{costs.bare_us:>8.1f}{costs.ratio:>7.1f}x"
            f"{costs.together_us:>10.1f}{costs.sent_us:>13.1f}"
            + (f"   REFUSED: {costs.refusal}" if costs.refusal else "")
        )


if __name__ == "__main__":
    sys.exit(main())
