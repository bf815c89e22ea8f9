"""Links of a lab with a radio that are slow, cut, divided and lossy; one lab for all tests."""

import asyncio
import json
import subprocess
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from tests.integration.lab.conftest import command, folder_of_labs
from tests.integration.lab.radio import at, order
from tests.patience import PATIENCE_S
from tests.patience import until as until_true

from swarmctl.session import labs
from swarmctl.session.labs import LabState
from swarmware.module.board import BoardReader
from swarmware.types.net import Neighbours
from swarmware.types.traffic import Traffic
from swarmware.types.vehicle import Pose

Done = subprocess.CompletedProcess[str]
Ctl = Callable[..., Done]

LOST_S = 2.0
"""Maximum time until a node notes that a neighbour is lost."""
TRIES = 3
"""A busy computer is late now and then, not always."""
OBSERVED_S = 20.0
"""Time over which loss is counted: about 200 beacons."""
OBSERVED = 150
"""Least number of beacons, lower than 200 because a busy computer sends its beacons more slowly."""


@pytest.fixture(scope="module")
def lab(rights: None) -> Iterator[tuple[LabState, Ctl]]:
    """Three nodes behind a radio that loses nothing itself."""
    with folder_of_labs() as folder:
        ctl = command(folder)
        ctl("lab", "up", "formation", "--nodes", "3", "--net", "netns", "--radio", "lan", "--detach")
        yield labs.find(), ctl


@pytest.fixture
def radio_lab(lab: tuple[LabState, Ctl]) -> LabState:
    """The lab without the cuts and impairments of an earlier test."""
    lab[1]("lab", "heal")
    return lab[0]


@pytest.fixture
def ctl(lab: tuple[LabState, Ctl]) -> Ctl:
    return lab[1]


def test_delay_and_rate_of_link_reach_nodes(radio_lab: LabState, ctl: Ctl) -> None:
    ctl("lab", "link", "uav1", "gcs", "--delay", "80ms", "--rate", "1mbit")

    async def measured() -> None:
        async with at(radio_lab, "gcs") as (module, until):
            board = module.reader("net/neighbours", Neighbours)
            async with asyncio.timeout(PATIENCE_S):
                # the mean approaches twice the delay; that it follows is enough
                while ((await until("uav1", "up")).rtt_ms or 0) < 100:
                    await board.changed()

    asyncio.run(measured())

    def shown() -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = json.loads(ctl("lab", "link", "uav1", "gcs", "--json").stdout)["links"]
        # the mean of each direction approaches its delay, and the directions carry unequal traffic
        return found if all(link["delay_s"] >= 0.08 for link in found) else []

    found = asyncio.run(until_true(shown, "80 ms of delay in both directions"))
    assert all(link["impairment"]["rate_bit_s"] == 1e6 for link in found)


async def test_cut_link_is_down_then_up_after_healing(radio_lab: LabState, ctl: Ctl) -> None:
    async with at(radio_lab, "gcs") as (module, until):
        for neighbour in ("uav1", "ugv1"):
            assert (await until(neighbour, "up")).address.startswith("10.83.0.")
        for words in (("cut", "gcs", "uav1"), ("link", "uav1", "gcs", "--loss", "100")):
            seen: list[tuple[float, bool]] = []
            while not seen or seen[-1][0] >= LOST_S or not seen[-1][1]:
                assert len(seen) < TRIES, (
                    f"seconds until it is down, and whether the other link stayed: {seen}"
                )
                before_ns = module.now_ns()
                await order(ctl, *words)
                ordered_ns = module.now_ns()
                late_s = ((await until("uav1", "down")).since_ns - ordered_ns) / 1e9
                seen.append((late_s, (await until("ugv1", "up")).since_ns < before_ns))
                await order(ctl, "heal")
                await until("uav1", "up")


async def test_one_way_cut_is_half_open_for_receiver(radio_lab: LabState, ctl: Ctl) -> None:
    async with at(radio_lab, "gcs") as (_, until):
        await until("uav1", "up")
        await order(ctl, "cut", "gcs", "uav1", "--one-way")
        await until("uav1", "half_open")


async def test_partition_separates_groups_and_leaves_links_inside_them(radio_lab: LabState, ctl: Ctl) -> None:
    async with at(radio_lab, "ugv1") as (_, until):
        await until("gcs", "up")
        await order(ctl, "partition", "uav1,ugv1", "gcs")
        await until("gcs", "down")
        await until("uav1", "up")
    found = json.loads(ctl("lab", "link", "gcs", "--json").stdout)["links"]
    assert {link["state"] for link in found} == {"cut"}
    assert all(link["cut"] > 0 for link in found if link["receiver"] == "uav1")


async def counted(board: BoardReader[Traffic], neighbour: str) -> tuple[int, int]:
    """Datagrams of a neighbour that the broker received, and those that it found missing."""
    async with asyncio.timeout(PATIENCE_S):
        while True:  # a value made before the link came up does not list it
            for link in (await board.changed()).links:
                if (link.platform, link.transport) == (neighbour, "udp"):
                    return link.received_frames, link.lost


@pytest.mark.slow
async def test_counted_loss_is_loss_of_radio(radio_lab: LabState, ctl: Ctl) -> None:
    def of_radio() -> tuple[int, int]:
        (link,) = json.loads(ctl("lab", "link", "uav1", "gcs", "--one-way", "--json").stdout)["links"]
        return link["frames"], link["lost"]

    async with at(radio_lab, "gcs") as (module, until):
        await until("uav1", "up")
        module.readers("/*/nav/pose", Pose)  # poses are asked for: beacons at full rate
        traffic = module.reader("net/traffic", Traffic)
        await order(ctl, "link", "uav1", "gcs", "--loss", "30", "--one-way")
        before, radio_before = await counted(traffic, "uav1"), await asyncio.to_thread(of_radio)
        ends_ns = module.now_ns() + round(OBSERVED_S * 1e9)
        after = before
        while module.now_ns() < ends_ns or sum(after) - sum(before) < OBSERVED:
            after = await counted(traffic, "uav1")
        radio_after = await asyncio.to_thread(of_radio)
    received, lost = (b - a for a, b in zip(before, after, strict=True))
    frames, frames_lost = (b - a for a, b in zip(radio_before, radio_after, strict=True))
    # four standard deviations of so many beacons
    assert lost / (received + lost) == pytest.approx(0.3, abs=0.15)
    assert lost / (received + lost) == pytest.approx(frames_lost / (frames + frames_lost), abs=0.1)
