"""Two nodes in a network namespace of their own; prints what the brokers counted and what a capture saw.

Run by test_bytes.py as `unshare --net python onthewire.py STEPS CARRIER`: nobody else's bytes are on this
loopback. A packet socket captures every IP packet once, as it leaves.
"""

import asyncio
import json
import socket
import struct
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import uvloop
from tests.integration.broker.swarm import Station, swarm
from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmd.broker.core.traffic import EVERYBODY
from swarmware.model.frame import FrameKind
from swarmware.types.scalar import Blob, Text
from swarmware.types.traffic import Traffic
from swarmware.types.vehicle import Pose

NAMES: Final = ("uav1", "uav2")
GROUP: Final = "239.83.87.1"
PROTOCOLS: Final = {6: "tcp", 17: "udp"}
_SOL_PACKET: Final = 263
_PACKET_STATISTICS: Final = 6
_SO_RCVBUFFORCE: Final = 33
_ETH_P_ALL: Final = 3
_ETH_P_IP: Final = 0x0800
_PACKET_OUTGOING: Final = 4
_BUFFER_BYTES: Final = 64 << 20
_ENDS: Final = struct.Struct("!HH")

Flow = tuple[str, str, str]
"""Protocol, sender, receiver; `*`: the group."""


class Capture:
    """Bytes of IP packets by protocol, sender and receiver."""

    def __init__(self, owners: dict[int, str]) -> None:
        """`owners`: of the ports at which nodes listen; any other port is the end of a connection of the
        other node."""
        self._owners = owners
        self.bytes: Counter[Flow] = Counter()
        self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(_ETH_P_ALL))
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _BUFFER_BYTES)
        self._socket.bind(("lo", _ETH_P_ALL))
        self._socket.setblocking(False)

    def drain(self) -> None:
        """Takes all captured packets."""
        while True:
            try:
                packet, address = self._socket.recvfrom(1 << 16)
            except BlockingIOError:
                return
            if address[1] == _ETH_P_IP and address[2] == _PACKET_OUTGOING:
                self._take(packet)

    def _take(self, packet: bytes) -> None:
        length = int.from_bytes(packet[2:4], "big")
        source, target = _ENDS.unpack_from(packet, (packet[0] & 15) * 4)
        protocol = PROTOCOLS.get(packet[9])
        if protocol is None:
            return  # the kernel refuses datagrams before a node listens
        to_group = socket.inet_ntoa(packet[16:20]) == GROUP
        receiver = EVERYBODY if to_group else self._owner(target, source)
        self.bytes[protocol, self._owner(source, target), receiver] += length

    def _owner(self, port: int, other_port: int) -> str:
        if port in self._owners:
            return self._owners[port]
        [one] = [name for name in NAMES if name != self._owners[other_port]]
        return one

    def missed(self) -> int:
        """Packets for which the buffer had no room."""
        data = self._socket.getsockopt(_SOL_PACKET, _PACKET_STATISTICS, 8)
        return int(struct.unpack("II", data)[1])

    def close(self) -> None:
        """Ends the capture."""
        self._socket.close()


@contextmanager
def capturing(owners: dict[int, str]) -> Iterator[Capture]:
    """A capture that the event loop empties."""
    capture, loop = Capture(owners), asyncio.get_running_loop()
    loop.add_reader(capture._socket.fileno(), capture.drain)
    try:
        yield capture
    finally:
        loop.remove_reader(capture._socket.fileno())
        capture.close()


def other(name: str) -> str:
    """The other node."""
    return NAMES[1 - NAMES.index(name)]


def byte_counters(table: Traffic, peer: str) -> Counter[str]:
    """The byte counters of a node."""
    rows = [row for row in table.links if row.transport == "udp"]
    return Counter(
        {
            "udp sent": table.udp_sent_bytes,
            "udp received": table.udp_received_bytes,
            "tcp sent": table.tcp_sent_bytes,
            "tcp received": table.tcp_received_bytes,
            "sent": table.sent_bytes,
            "received": table.received_bytes,
            "group sent": sum(row.sent_bytes for row in rows if row.platform == EVERYBODY),
            "link sent": sum(row.sent_bytes for row in rows if row.platform == peer),
            "links received": sum(row.received_bytes for row in rows),
        }
    )


def captured(name: str, seen: Counter[Flow]) -> dict[str, int]:
    """Captured datagrams of each of these counters."""
    peer = other(name)
    udp_out = {to: seen["udp", name, to] for to in (EVERYBODY, peer)}
    udp_in = seen["udp", peer, EVERYBODY] + seen["udp", peer, name]
    tcp_out, tcp_in = seen["tcp", name, peer], seen["tcp", peer, name]
    return {
        "udp sent": sum(udp_out.values()),
        "udp received": udp_in,
        "tcp sent": tcp_out,
        "tcp received": tcp_in,
        "sent": sum(udp_out.values()) + tcp_out,
        "received": udp_in + tcp_in,
        "group sent": udp_out[EVERYBODY],
        "link sent": udp_out[peer],
        "links received": udp_in,
    }


async def exchange(pair: dict[str, Station], steps: int) -> None:
    """Poses of both, requests, messages and streams, small and large."""
    writers = [station.app.writer("nav/pose", Pose) for station in pair.values()]
    first = pair["uav1"].app
    for step in range(steps):
        for writer in writers:
            writer.write(Pose.planar(float(step), 0.0))
        size = 20_000 if step % 10 == 0 else 50
        await first.request("/uav2/cmd/echo", Blob(bytes(size)), Blob, timeout_s=60)
        await pair["uav2"].app.send("/uav1/cmd/none", Text("x"), timeout_s=0.05)
        await first.send("/uav2/plan/share", Text("y" * 500), kind=FrameKind.STREAM, timeout_s=PATIENCE_S)


async def measure(root: Path, steps: int, carrier: str) -> dict[str, tuple[int, int]]:
    ports = {name: (free_port(), free_port()) for name in NAMES}
    settings = {name: {"unicast_port": udp, "tcp_port": tcp} for name, (udp, tcp) in ports.items()}
    owners = {port: name for name, both in ports.items() for port in both}
    with capturing(owners) as capture:
        async with swarm(root, *NAMES, settings=settings, frames=carrier) as pair:
            pair["uav2"].app.serve("cmd/echo", Blob, lambda request, _: request, reply=Blob)
            pair["uav2"].app.inbox("plan/share", Text)
            for name, station in pair.items():
                station.plan([("nav/pose", Pose)], [(other(name), "nav/pose", Pose)])
                await station.until_up(other(name))
            before = await counters_of(pair)
            capture.drain()
            capture.bytes.clear()
            await exchange(pair, steps)
            await asyncio.sleep(0.3)  # acknowledgements of TCP come with a delay of up to 0.2 s
            after = await counters_of(pair)
            capture.drain()
            assert not capture.missed()
            return {
                f"{name}: {what}": (after[name][what] - before[name][what], size)
                for name in NAMES
                for what, size in captured(name, capture.bytes).items()
            }


async def counters_of(pair: dict[str, Station]) -> dict[str, Counter[str]]:
    """The byte counters of both nodes."""
    return {name: byte_counters(await station.traffic(), other(name)) for name, station in pair.items()}


if __name__ == "__main__":
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    with (
        tempfile.TemporaryDirectory(prefix="sw") as folder,
        asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner,
    ):
        print(json.dumps(runner.run(measure(Path(folder), int(sys.argv[1]), sys.argv[2]))))
