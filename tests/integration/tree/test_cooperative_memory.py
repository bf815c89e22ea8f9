"""Cooperative memory: a vehicle out of the ground station's range shares its tables through another one."""

import asyncio
from pathlib import Path

from tests.integration.tree.pair import on_uvloop, platforms, until
from tests.patience import PATIENCE_S

from swarmware.types.scalar import Text

LINE = {"uav1": ("uav2",), "uav2": ("uav1", "gcs"), "gcs": ("uav2",)}


@on_uvloop
async def test_vehicle_out_of_range_has_tables_of_swarm(
    tmp_path: Path,
) -> None:
    async with platforms(tmp_path, "uav1", "uav2", "gcs", hear=LINE) as (far, middle, gcs):
        # every node shares its own table, and reads the tables of the two others
        boards = {
            node.name: node.probe.writer("plan/table", Text, link="notify") for node in (far, middle, gcs)
        }
        copies = {
            (node.name, other.name): node.probe.reader(f"/{other.name}/plan/table", Text)
            for node in (far, middle, gcs)
            for other in (far, middle, gcs)
            if node is not other
        }
        alarms = gcs.probe.inbox("plan/alarm", Text)
        for turn in ("first", "second"):
            for name, board in boards.items():
                board.write(Text(f"{turn} of {name}"))
            for (_, owner), copy in copies.items():
                expected = f"{turn} of {owner}"
                await until(copy, lambda value, expected=expected: value.value == expected)  # type: ignore[misc]
        outcome = await far.probe.send(
            "/gcs/plan/alarm", Text("low battery"), timeout_s=PATIENCE_S, urgent=True
        )
        assert outcome, outcome
        assert (await alarms.next(PATIENCE_S)).value == "low battery"

        # without the one between them the values stay readable, and follow when it is back
        await middle.end("broker", "tree", "register")
        boards["gcs"].write(Text("third of gcs"))
        assert copies["uav1", "gcs"].value == Text("second of gcs")
        outcome = await far.probe.send("/gcs/plan/alarm", Text("lost"), timeout_s=0.5, urgent=True)
        assert not outcome
        await middle.start("broker", "tree", "register")
        await until(copies["uav1", "gcs"], lambda value: value.value == "third of gcs")
        async with asyncio.timeout(PATIENCE_S):
            while not await far.probe.send("/gcs/plan/alarm", Text("back"), timeout_s=2, urgent=True):
                pass
        assert (await alarms.next(PATIENCE_S)).value == "back"
