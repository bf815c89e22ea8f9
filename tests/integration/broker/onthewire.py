"""Three nodes in a network namespace of their own; prints what the brokers counted and what the kernel saw.

Run by test_bytes.py as `unshare --net python onthewire.py`: nobody else's bytes are on this loopback.
"""

import asyncio
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import uvloop
from tests.integration.broker.swarm import swarm

from swarmware.types.scalar import Blob, Text
from swarmware.types.vehicle import Pose

NAMES = ("uav1", "uav2", "uav3")


def loopback_bytes() -> int:
    """Bytes that the loopback interface sent since it is up, IP headers included."""
    for line in Path("/proc/net/dev").read_text().splitlines():
        name, _, figures = line.partition(":")
        if name.strip() == "lo":
            return int(figures.split()[8])
    raise RuntimeError("no loopback interface")


async def measure(root: Path, steps: int) -> dict[str, float]:
    """Poses between all, requests and a few large messages from one to another."""
    async with swarm(root, *NAMES) as cell:
        cell["uav3"].app.serve("cmd/echo", Blob, lambda request, _: request, reply=Blob)
        writers = [station.app.writer("nav/pose", Pose) for station in cell.values()]
        for name, station in cell.items():
            others = [other for other in NAMES if other != name]
            station.plan([("nav/pose", Pose)], [(other, "nav/pose", Pose) for other in others])
            await station.until_up(*others)
        for step in range(steps):
            for writer in writers:
                writer.write(Pose.planar(float(step), 0.0))
            size = 20_000 if step % 10 == 0 else 50
            await cell["uav1"].app.request("/uav3/cmd/echo", Blob(bytes(size)), Blob, timeout_s=60)
            await cell["uav2"].app.send("/uav1/cmd/none", Text("x"), timeout_s=0.05)
        await asyncio.sleep(0.3)  # acknowledgements of TCP come with a delay of up to 0.2 s
        wire = loopback_bytes()
        tables = [await station.traffic() for station in cell.values()]
        return {
            "wire": wire,
            "sent": sum(table.sent_bytes for table in tables),
            "udp": sum(table.udp_sent_bytes for table in tables),
            "tcp": sum(table.tcp_sent_bytes for table in tables),
            "tcp_received": sum(table.tcp_received_bytes for table in tables),
            "udp_received": sum(table.udp_received_bytes for table in tables),
        }


if __name__ == "__main__":
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    with (
        tempfile.TemporaryDirectory(prefix="sw") as folder,
        asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner,
    ):
        print(json.dumps(runner.run(measure(Path(folder), int(sys.argv[1])))))
