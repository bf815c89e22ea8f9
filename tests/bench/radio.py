"""Own delay and capacity of a lab's radio: of its core alone, and of its process with two namespaces.

    python tests/bench/radio.py [--frames N] [--json]

Core: frames of 300 bytes to all of 16 nodes, without devices. Process: two programs in two namespaces of a
lab that starts no nodes exchange datagrams of 200 bytes over the radio `lan`, which has no delay. Own
delay: half the round trip, without half of that over the loopback of the computer, measured in the same run.
Capacity: datagrams per second that arrive of a sender that does not wait. Needs the rights of `--net netns`.
"""

import argparse
import asyncio
import json
import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.session.labs import LabNode, LabState
from swarmlab.provision import provisioning
from swarmlab.provision.provisioning import LabSpec
from swarmlab.radio.core.network import RadioCore, RadioNode
from swarmlab.radio.files import find_radio, load_radio
from swarmlab.radio.process import ethernet_address
from swarmlab.run import running
from swarmlab.run.running import RunningLab

PORT: Final = 20_009
NODES: Final = 16
PAYLOAD: Final = 200
FLOOD_S: Final = 2.0

ECHO: Final = """
import socket, sys
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.bind((sys.argv[1], int(sys.argv[2])))
print(flush=True)
while True:
    data, address = s.recvfrom(2048)
    if data[:1] == b"e":
        s.sendto(data, address)
    elif data[:1] == b"q":
        break
    else:
        count = 1
        s.settimeout(0.5)
        try:
            while s.recvfrom(2048)[0][:1] == b"f":
                count += 1
        except TimeoutError:
            pass
        s.settimeout(None)
        s.sendto(str(count).encode(), address)
"""
PROBE: Final = """
import json, socket, sys, time
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.settimeout(5)
to, flood_s = (sys.argv[1], int(sys.argv[2])), float(sys.argv[5])
frames, payload = int(sys.argv[3]), int(sys.argv[4])
took = []
for _ in range(frames):
    began = time.perf_counter()
    s.sendto(b"e" * payload, to)
    s.recvfrom(2048)
    took.append(time.perf_counter() - began)
sent, ends = 0, time.perf_counter() + flood_s
while flood_s and time.perf_counter() < ends:
    s.sendto(b"f" * payload, to)
    sent += 1
arrived = int(s.recvfrom(2048)[0]) if flood_s else 0
s.sendto(b"q", to)
print(json.dumps({"took_s": took[frames // 10:], "sent": sent, "arrived": arrived}))
"""


class Probe(msgspec.Struct, frozen=True):
    """What one program measured."""

    took_s: list[float]
    sent: int
    arrived: int


def core_frames_s(frames: int) -> float:
    """Broadcast frames that the core takes in a second of processor time, each with fifteen arrivals."""
    nodes = [RadioNode(f"uav{i}", f"uav{i}", True, ethernet_address(i)) for i in range(NODES)]
    core = RadioCore(*load_radio(find_radio("s3")), nodes, random.Random(1).random, 0)
    data, now_ns = b"\xff" * 300, 0
    began = time.process_time()
    for number in range(frames):
        now_ns += 5_000_000
        core.on_timer(now_ns)
        core.on_frame(number % NODES, data, now_ns)
    return frames / (time.process_time() - began)


def exchange(echo: list[str], probe: list[str], address: str, frames: int, flood_s: float) -> Probe:
    """Round trips and a flood between two programs, each behind a command that chooses its namespace."""
    program = [sys.executable, "-c"]
    with subprocess.Popen([*echo, *program, ECHO, address, str(PORT)], stdout=subprocess.PIPE) as server:
        assert server.stdout is not None
        server.stdout.readline()
        words = (address, PORT, frames, PAYLOAD, flood_s)
        done = subprocess.run([*probe, *program, PROBE, *map(str, words)], capture_output=True, check=True)
    return msgspec.json.decode(done.stdout, type=Probe)


def enter(node: LabNode) -> list[str]:
    """Command that starts a program in the namespaces of a node."""
    words = running.command(node)
    return words[: words.index(sys.executable)]


async def over_radio(lab: LabState, frames: int) -> Probe:
    """The same exchange between two nodes of a lab."""
    started = RunningLab(lab)
    await started.start_shared(20)
    try:
        one, other = lab.nodes[:2]
        return await asyncio.to_thread(exchange, enter(one), enter(other), one.address, frames, FLOOD_S)
    finally:
        started.stop_watching()
        provisioning.down(lab)
        started.wait_children()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--frames", type=int, default=2000)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="sw", dir="/tmp") as folder:
        os.environ["SWARMCTL_LABS"] = folder
        Path(folder).chmod(0o700)
        spec = LabSpec(experiment="formation", nodes=3, seed=1, net="netns", radio="lan")
        radio = asyncio.run(over_radio(provisioning.make(spec), args.frames))
    bare = exchange([], [], "127.0.0.1", args.frames, 0.0)
    half_ms = [took_s * 500 for took_s in radio.took_s]
    bare_ms = statistics.median(bare.took_s) * 500
    found = {
        "core_broadcasts_s": core_frames_s(args.frames),
        "own_delay_p50_ms": statistics.median(half_ms) - bare_ms,
        "own_delay_p99_ms": statistics.quantiles(half_ms, n=100)[98] - bare_ms,
        "loopback_p50_ms": bare_ms,
        "arrived_frames_s": radio.arrived / FLOOD_S,
        "sent_frames_s": radio.sent / FLOOD_S,
    }
    if args.json:
        print(json.dumps(found, indent=2))
    else:
        for name, value in found.items():
            print(f"{name:20} {value:10.3f}" if value < 100 else f"{name:20} {value:10.0f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
