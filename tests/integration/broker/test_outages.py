"""Outages of a link between two brokers: recorded, published, and kept over a restart."""

import asyncio
from pathlib import Path

from tests.integration.broker.swarm import Station, on_uvloop, swarm
from tests.patience import PATIENCE_S

from swarmware.types.outage import NodeLinks, OutageTable
from swarmware.types.rpc import Empty


async def outages(station: Station) -> OutageTable:
    return await station.app.request("sys/broker/outages", Empty(), OutageTable, timeout_s=PATIENCE_S)


@on_uvloop
async def test_record_of_lost_neighbour_ends_with_its_return(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        first, second = pair.values()
        board = first.app.reader("net/outages", OutageTable)
        summary = first.app.reader("net/links", NodeLinks)
        await first.until_up("uav2")
        assert await outages(first) == OutageTable()
        await second.stop()
        await first.until(lambda: bool(board.value and board.value.outages), board)
        await first.until(lambda: summary.value is not None and summary.value.outages == 1, summary)
        [lost] = (await outages(first)).outages
        assert (lost.platform, lost.phase, lost.cause) == ("uav2", "lost", "silent")
        assert 0.5 < lost.detected_after_s < 10
        await second.start()
        await first.until(lambda: board.value is not None and board.value.outages[0].phase == "over", board)
        [over] = (await outages(first)).outages
        assert over.began_utc_ns == lost.began_utc_ns
        assert over.down_for_s is not None and over.down_for_s >= over.detected_after_s
        assert over.recovered_in_s is not None and over.recovered_in_s >= 0
        assert over.drained_in_s is not None
        await first.stop()
        await first.start()
        assert (await outages(first)).outages == (over,), "the record survives the broker"


@on_uvloop
async def test_damaged_file_of_outages_does_not_stop_broker(tmp_path: Path) -> None:
    async with swarm(tmp_path, "uav1", "uav2") as pair:
        station = pair["uav1"]
        await station.stop()
        file = station.node.config.data_path / "broker.outages"
        await asyncio.to_thread(file.write_bytes, b'{"outages": 7}')
        await station.start()
        await station.until_up("uav2")
        assert await outages(station) == OutageTable()
