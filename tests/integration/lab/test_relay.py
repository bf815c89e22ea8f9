"""The relay between sockets that stand for nodes, and a lab of a user without any rights on it."""

import asyncio
import os
import socket
import struct
import subprocess
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from tests.integration.lab.test_radio import NONE, at, order
from tests.patience import PATIENCE_S

from swarmctl.session import labs
from swarmctl.session.labs import LabState
from swarmlab.provision import provisioning
from swarmlab.provision.provisioning import LabSpec
from swarmlab.radio import orders
from swarmlab.radio.core.link import ImpairmentChange
from swarmlab.radio.orders import CutLinks, HealLinks, ImpairLinks
from swarmlab.radio.relay_plan import RelayPlan
from swarmlab.run.radio_child import RadioChild

Done = subprocess.CompletedProcess[str]
Ctl = Callable[..., Done]
Gone = Callable[[LabState], None]

GCS, UGV, UAV = range(3)
BOTH = (("gcs", "uav1"), ("uav1", "gcs"))


@asynccontextmanager
async def relay(labs_folder: Path) -> AsyncIterator[tuple[LabState, RelayPlan]]:
    """The relay of a lab whose nodes do not run."""
    lab = provisioning.make(LabSpec(experiment="formation", nodes=3, seed=1, net="relay", radio="lan"))
    child = RadioChild(lab, lambda: None)
    try:
        await child.start(PATIENCE_S)
        yield lab, RelayPlan(lab.multicast_group, lab.udp_port)
    finally:
        child.stop_watching()
        provisioning.down(lab)
        child.wait()


def bound(plan: RelayPlan, node: int, *, group: bool = False) -> socket.socket:
    """The socket of a node for its own datagrams, or for those of its group."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    host = plan.group_of(node) if group else plan.node(node)
    lo = struct.pack("@4s4si", socket.inet_aton(plan.group_of(node)), socket.inet_aton(plan.node(node)), 0)
    if group:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sock.bind((host, plan.port))
    sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP if group else socket.IP_MULTICAST_IF, lo)
    sock.settimeout(PATIENCE_S)
    return sock


async def test_datagrams_reach_the_others_from_the_address_to_which_they_answer(labs_folder: Path) -> None:
    async with relay(labs_folder) as (lab, plan):
        with bound(plan, GCS) as gcs, bound(plan, UAV) as uav, bound(plan, UAV, group=True) as heard:
            gcs.sendto(b"to all", (plan.group_of(GCS), plan.port))
            assert await asyncio.to_thread(heard.recvfrom, 100) == (
                b"to all",
                (plan.seen(GCS, UAV), plan.port),
            )
            uav.sendto(b"answer", (plan.seen(GCS, UAV), plan.port))
            assert await asyncio.to_thread(gcs.recvfrom, 100) == (b"answer", (plan.seen(UAV, GCS), plan.port))
            orders.send(Path(lab.folder), CutLinks((BOTH[0],)))
            gcs.sendto(b"lost", (plan.seen(UAV, GCS), plan.port))
            uav.sendto(b"still", (plan.seen(GCS, UAV), plan.port))
            assert (await asyncio.to_thread(gcs.recvfrom, 100))[0] == b"still"
            (report,) = orders.send(Path(lab.folder), HealLinks((BOTH[0],)))
            assert (report.cut, report.frames) == (1, 1)
            gcs.sendto(b"again", (plan.seen(UAV, GCS), plan.port))
            assert (await asyncio.to_thread(uav.recvfrom, 100))[0] == b"again"


async def test_a_connection_is_slow_and_not_lossy_where_frames_are_lost_and_waits_for_the_end_of_a_cut(
    labs_folder: Path,
) -> None:
    data, peers = bytes(range(250)) * 800, []

    async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        peers.append(writer.get_extra_info("peername")[0])
        while got := await reader.read(65_536):
            writer.write(got)
        writer.close()

    async with relay(labs_folder) as (lab, plan), asyncio.timeout(PATIENCE_S):
        folder = Path(lab.folder)
        orders.send(folder, ImpairLinks(BOTH, ImpairmentChange(loss_ratio=0.1, delay_s=0.002)))
        async with await asyncio.start_server(echo, plan.node(UAV), plan.urgent_port):
            reader, writer = await asyncio.open_connection(plan.seen(UAV, GCS), plan.urgent_port)
            writer.write(data)
            assert await reader.readexactly(len(data)) == data
            assert peers == [plan.seen(GCS, UAV)]
            reports = orders.send(folder, CutLinks(BOTH))
            assert all(report.lost > 0 for report in reports)
            writer.write(b"after the cut")
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.5):
                    await reader.read(1)
            orders.send(folder, HealLinks(BOTH))
            assert await reader.readexactly(13) == b"after the cut"
            writer.write_eof()
            assert await reader.read() == b"", "the end has passed both ways"
            writer.close()
        refused, writer = await asyncio.open_connection(plan.seen(UGV, GCS), plan.urgent_port)
        assert await refused.read() == b"", "no node listens there"
        writer.close()


def test_a_user_without_any_rights_gets_a_lab_whose_links_obey(
    labs_folder: Path, ctl: Ctl, nothing_remains: Gone
) -> None:
    done = subprocess.run(
        [
            *(
                "unshare",
                "--user",
                "--map-root-user",
                "sh",
                "-c",
                NONE,
                "sh",
                sys.executable,
                "-m",
                "swarmctl",
            ),
            *("lab", "up", "formation", "--nodes", "3", "--net", "relay", "--detach"),
        ],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "SWARMCTL_LABS": str(labs_folder)},
    )
    if "unshare failed" in done.stderr:
        pytest.skip(done.stderr)
    assert done.returncode == 0, done.stderr
    lab = labs.find()

    async def impaired() -> None:
        async with at(lab, "gcs") as (_, until):
            assert (await until("uav1", "up")).address.startswith("127.84.1.3:")
            await order(ctl, "cut", "gcs", "uav1", "--one-way")
            await until("uav1", "half_open")
            await order(ctl, "heal")
            await until("uav1", "up")
            await order(ctl, "partition", "gcs", "uav1,ugv1")
            await until("uav1", "down")
            await until("ugv1", "down")

    asyncio.run(impaired())
    ctl("lab", "down")
    nothing_remains(lab)
