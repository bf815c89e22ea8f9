"""Two brokers with several media between them at once."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from tests.integration.broker.lines import Line
from tests.integration.broker.swarm import Station, on_uvloop, swarm
from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmware.types.net import LinkStatus, MediumState, MediumUse
from swarmware.types.scalar import Text

NAMES = ("uav1", "uav2")


@asynccontextmanager
async def two_lines(tmp_path: Path, **common: Any) -> AsyncIterator[tuple[Line, Line, Station, Station]]:
    """uav1 and uav2 on a fast and on a slow line."""
    (tmp_path / "fast").mkdir()
    (tmp_path / "slow").mkdir()
    fast, slow = Line(tmp_path / "fast"), Line(tmp_path / "slow")
    try:
        settings = {
            name: {
                "serial": [
                    {"name": "fast", "device": str(fast.devices[at]), "baud": 921_600},
                    {"name": "slow", "device": str(slow.devices[at]), "baud": 57_600},
                ]
            }
            for at, name in enumerate(NAMES)
        }
        async with swarm(tmp_path, *NAMES, settings=settings, **{"multicast_group": "", **common}) as found:
            yield fast, slow, found["uav1"], found["uav2"]
    finally:
        fast.close()
        slow.close()


def media(station: Station) -> dict[str, MediumState]:
    """What it says of the media to its only neighbour."""
    table = station.neighbours.value
    if table is None or not table.neighbours:
        return {}
    return {medium.medium: medium for medium in table.neighbours[0].media}


async def until_up(station: Station, *names: str) -> None:
    """Waits until these media are up, and no others."""

    def is_so() -> bool:
        return {name for name, one in media(station).items() if one.state == LinkStatus.UP} == set(names)

    await station.until(is_so, station.neighbours)


def chosen(station: Station) -> str:
    """The medium of its packets."""
    return "".join(n for n, one in media(station).items() if one.use in (MediumUse.OUT, MediumUse.BOTH))


@on_uvloop
async def test_faster_line_carries_packets_until_it_is_lost(tmp_path: Path) -> None:
    async with two_lines(tmp_path) as (fast, _, one, other):
        await until_up(one, "fast", "slow")
        await until_up(other, "fast", "slow")
        await one.until(lambda: chosen(one) == "fast", one.neighbours)
        inbox = other.app.inbox("cmd/order", Text)
        assert await one.app.send("/uav2/cmd/order", Text("first"), timeout_s=PATIENCE_S)
        assert (await anext(inbox)).value == "first"

        fast.unplug()
        await one.until(lambda: chosen(one) == "slow", one.neighbours)
        await until_up(one, "slow")
        assert one.states() == {"uav2": "up"}, "the neighbour was never lost"
        assert await one.app.send("/uav2/cmd/order", Text("second"), timeout_s=PATIENCE_S)
        assert (await anext(inbox)).value == "second"

        fast.plug()
        await one.until(lambda: chosen(one) == "fast", one.neighbours)


@on_uvloop
async def test_command_goes_by_all_media_and_arrives_once(tmp_path: Path) -> None:
    async with two_lines(tmp_path) as (fast, _, one, other):
        await until_up(one, "fast", "slow")
        await until_up(other, "fast", "slow")
        await one.until(lambda: chosen(one) == "fast", one.neighbours)
        inbox = other.app.inbox("cmd/order", Text)
        for number in range(5):
            assert await one.app.send("/uav2/cmd/order", Text(f"{number}"), timeout_s=PATIENCE_S, urgent=True)
            assert (await anext(inbox)).value == f"{number}"
        traffic = await other.until_counted(
            lambda found: sum(link.duplicates for link in found.links if link.platform == "uav1") > 0
        )
        assert traffic.refused.replayed == 0, "a copy is no replay"
        for tries in range(5):
            fast.is_cut = True
            assert await one.app.send("/uav2/cmd/order", Text("cut"), timeout_s=PATIENCE_S, urgent=True)
            assert (await anext(inbox)).value == "cut"
            if chosen(one) == "fast":
                break  # nobody has noticed yet that this line is dead; a busy computer has now and then
            assert tries < 4
            fast.is_cut = False
            await until_up(one, "fast", "slow")
            await until_up(other, "fast", "slow")
            await one.until(lambda: chosen(one) == "fast", one.neighbours)
        await one.until(lambda: media(one)["fast"].state == LinkStatus.HALF_OPEN, one.neighbours)
        await one.until(lambda: chosen(one) == "slow", one.neighbours)


@on_uvloop
async def test_second_network_takes_frames_of_payload_link(tmp_path: Path) -> None:
    port = free_port()
    video = {"name": "video", "interface": "127.0.0.1", "udp_port": port, "carries": "payload"}
    async with swarm(tmp_path, *NAMES, network=[video]) as found:
        one, other = found["uav1"], found["uav2"]
        await until_up(one, "main", "video")
        await until_up(other, "main", "video")
        await one.until(lambda: chosen(one) == "video", one.neighbours)
        inbox = other.app.inbox("cmd/order", Text)
        assert await one.app.send("/uav2/cmd/order", Text("go"), timeout_s=PATIENCE_S)
        assert (await anext(inbox)).value == "go"


@on_uvloop
async def test_a_payload_link_alone_makes_no_neighbour(tmp_path: Path) -> None:
    port = free_port()
    video = {"name": "video", "interface": "127.0.0.1", "udp_port": port, "carries": "payload"}
    async with swarm(tmp_path, *NAMES, multicast_group="", network=[video]) as found:
        counted = await found["uav1"].until_counted(lambda traffic: traffic.received_datagrams >= 10)
        assert found["uav1"].states() == {}
        assert counted.refused.malformed == 0


@on_uvloop
async def test_nodes_sharing_one_network_are_neighbours_after_restart(
    tmp_path: Path,
) -> None:
    second = {"name": "radio2", "interface": "127.0.0.1", "udp_port": free_port()}
    async with swarm(tmp_path, *NAMES, settings={"uav1": {"network": [second]}}) as found:
        one, other = found["uav1"], found["uav2"]
        inbox = other.app.inbox("cmd/order", Text)
        for order in ("first", "second"):
            await one.until_up("uav2")
            await other.until_up("uav1")
            await until_up(one, "main")
            await one.until(lambda: chosen(one) == "main", one.neighbours)
            assert await one.app.send("/uav2/cmd/order", Text(order), timeout_s=PATIENCE_S)
            assert (await anext(inbox)).value == order
            await one.stop()
            await one.start()


@on_uvloop
async def test_second_network_accepts_connections_at_its_own_address(tmp_path: Path) -> None:
    second = {"name": "radio2", "interface": "127.0.0.2", "udp_port": free_port()}
    async with swarm(tmp_path, *NAMES, multicast_group="", frames="tcp", network=[second]) as found:
        one, other = found["uav1"], found["uav2"]
        await one.until_up("uav2")
        await other.until_up("uav1")
        await one.until(lambda: chosen(one) == "radio2", one.neighbours)
        inbox = other.app.inbox("cmd/order", Text)
        assert await one.app.send("/uav2/cmd/order", Text("go"), timeout_s=PATIENCE_S)
        assert (await anext(inbox)).value == "go"
