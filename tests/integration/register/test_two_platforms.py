"""Exchange of registers between platforms: reachable platforms stay, and returning platforms are known
again."""

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.integration.tree.pair import SERVICES, Platform, on_uvloop, platforms
from tests.patience import PATIENCE_S, until_answer

from swarmware.errors import NotFound
from swarmware.module.module import Module
from swarmware.module.partners import Partner, Partners
from swarmware.types.register import Register
from swarmware.types.rpc import Empty

FORGET_S = 1.0


async def known(at: Platform) -> dict[str, set[str]]:
    """Applications by platform, from the register of a node."""
    found = await at.probe.request("sys/register/apps", Empty(), Register, timeout_s=PATIENCE_S)
    return {unit.table.platform: {app.name for app in unit.table.applications} for unit in found.units}


async def until_known(at: Platform, what: Callable[[dict[str, set[str]]], bool]) -> None:
    await until_answer(lambda: known(at), what)


@on_uvloop
async def test_unchanged_partner_is_known_while_it_lives(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "gcs", start=False) as (uav, gcs):
        settings = gcs.config_dir / "services" / "register.toml"
        await asyncio.to_thread(settings.write_text, f"forget_s = {FORGET_S}\n")
        for node in (uav, gcs):
            await node.start(*SERVICES)
        await until_known(gcs, lambda units: {"probe", "broker", "tree"} <= units.get("uav1", set()))
        async with Module("late", config_dir=uav.config_dir):
            await until_known(gcs, lambda units: "late" in units["uav1"])
        await until_known(gcs, lambda units: "late" not in units["uav1"])
        loop = asyncio.get_running_loop()
        end_s = loop.time() + 2.5 * FORGET_S
        while loop.time() < end_s:
            assert "uav1" in await known(gcs)
            await asyncio.sleep(0.1)
        await uav.end(*SERVICES)
        await until_known(gcs, lambda units: "uav1" not in units)
        await uav.start(*SERVICES)
        await until_known(gcs, lambda units: "probe" in units.get("uav1", set()))


async def until_partners(partners: Partners, what: Callable[[tuple[Partner, ...]], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        found = tuple(partners)
        while not what(found):
            found = await partners.changed()


@on_uvloop
async def test_every_module_has_partners_without_running_register(tmp_path: Path) -> None:
    async with platforms(tmp_path, "uav1", "gcs", start=False) as (uav, gcs):
        await uav.start(*SERVICES)
        await gcs.start("broker", "tree")
        register = await gcs.start("register")
        partners = gcs.probe.partners()
        await until_partners(
            partners, lambda units: [one.runs("probe") and one.runs("tree") for one in units] == [True]
        )
        (partner,) = partners.of("uav1")
        assert (partner.unit, partner.hops, partner.unreachable_s) == ("main", 1, None)
        assert 0 <= partner.age_s < PATIENCE_S
        with pytest.raises(NotFound, match="expected one of: uav1"):
            partners.of("uav7")

        await register.kill()
        async with Module("stand_in", config_dir=gcs.config_dir) as stand_in:
            held = stand_in.partners()
            assert held.of("uav1")[0].runs("probe"), "from the board, at once"
            await gcs.start("register")
            async with Module("late", config_dir=uav.config_dir):
                await until_partners(held, lambda units: any(one.runs("late") for one in units))
            await until_partners(held, lambda units: not any(one.runs("late") for one in units))
            await gcs.end("register")
            assert held.of("uav1")[0].runs("probe"), "also when the register ends in good order"
