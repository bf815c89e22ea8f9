"""A swarm is made by its commands: nodes of real processes join, see each other, and learn of changes."""

import asyncio
import signal
from pathlib import Path

from tests.integration.enrolment.operator_commands import Operator, ended
from tests.patience import PATIENCE_S
from tests.ports import free_port

from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.testing.process import spawn
from swarmware.testing.tmpnode import make_node
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.root import Root
from swarmware.types.net import Routes
from swarmware.types.tree import TreeList, TreeListing


async def until(routes: BoardReader[Routes], *platforms: str) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while routes.value is None or {route.platform for route in routes.value.routes} != set(platforms):
            await routes.changed()


async def until_computers(routes: BoardReader[Routes], *names: str) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while routes.value is None or {route.name for route in routes.value.routes} != set(names):
            await routes.changed()


async def known(probe: Module) -> set[str]:
    """Platforms that the tree of the ground station knows."""
    found = await probe.request("sys/tree/list", TreeList("/gcs/none", 1), TreeListing, timeout_s=PATIENCE_S)
    return {one.platform for one in found.platforms}


async def until_known(probe: Module, *platforms: str) -> None:
    """Until the tree knows these; each request waits for its answer."""
    async with asyncio.timeout(PATIENCE_S):
        while await known(probe) != set(platforms):
            pass


async def test_joined_nodes_meet_and_learn_of_changes(tmp_path: Path) -> None:
    broker = {"udp_port": free_port(), "bind_address": "127.0.0.1", "multicast_interface": "127.0.0.1"}
    base, vehicle, other = (
        make_node(tmp_path, name, kind=kind, services={"broker": broker, "tree": {}})
        for name, kind in (("gcs", "gcs"), ("uav1", "uav"), ("uav2", "uav"))
    )
    second = make_node(
        tmp_path, "uav1.fc", services={"broker": broker, "tree": {}}, keys_dir=str(tmp_path / "uav1/keys")
    )
    root, operator = tmp_path / "root", Operator(tmp_path / "root")
    await operator.keys(base, "init", "--swarm", "harbour")
    async with operator.inviting(base, "uav1") as (token,):
        await operator.keys(vehicle, "join", token)
    async with (
        spawn(base, "broker", "tree"),
        spawn(vehicle, "broker", "tree"),
        Module("probe", config_dir=base) as probe,
    ):
        routes = probe.reader("net/routes", Routes)
        await until(routes, "uav1")

        async with operator.inviting(base, "uav2") as (token,):
            await operator.keys(other, "join", token)
        async with spawn(other, "broker", "tree"):
            await until(routes, "uav1", "uav2")
            shown = await operator.keys(base, "rotate")
            assert [line.split()[:3] for line in shown.splitlines()[1:]] == [
                ["gcs", "4", "yes"],
                ["uav1", "4", "yes"],
                ["uav2", "4", "yes"],
            ]
            listed = await operator.keys(base, "ls")
            assert [line.split()[-2:] for line in listed.splitlines()[2:]] == [["4", "yes"]] * 3
        await until(routes, "uav1")
        async with operator.inviting(base, "scout") as (token,):
            await operator.run(other, "node", "rename", "uav2", "scout", "--token", token, "--yes")
        async with spawn(other, "broker", "tree"):
            await until(routes, "uav1", "scout")
            await until_known(probe, "gcs", "uav1", "scout")  # the same key: no command for the former name
            async with spawn(second, "broker", "tree"):  # a further computer of uav1
                await until_computers(routes, "uav1", "uav1.fc", "scout")
                shown = await operator.run(base, "node", "remove", "scout", "--yes")
                assert [line.split()[:2] for line in shown.splitlines()[1:]] == [
                    ["gcs", "yes"],
                    ["uav1", "yes"],
                    ["uav1.fc", "yes"],
                ]
                await until_computers(routes, "uav1", "uav1.fc")
                assert await known(probe) == {"gcs", "uav1"}
                shown = await operator.run(base, "node", "remove", "uav1", "--yes")
                assert [line.split()[:2] for line in shown.splitlines()[1:]] == [["gcs", "yes"]]
                await until_computers(routes)  # both of its computers
                assert await known(probe) == {"gcs"}
    assert Keys.load(base.parent / "keys", "gcs").signed == Root.load(root).signed


async def test_node_that_joins_without_multicast_finds_its_inviter(tmp_path: Path) -> None:
    common = {"bind_address": "127.0.0.1", "multicast_group": "", "udp_port": free_port()}
    base = make_node(
        tmp_path, "gcs", kind="gcs", services={"broker": {**common, "unicast_port": free_port()}}
    )
    vehicle = make_node(tmp_path, "uav1", services={"broker": common})
    operator = Operator(tmp_path / "root")
    await operator.keys(base, "init")
    async with spawn(base, "broker"), Module("probe", config_dir=base) as probe:
        routes = probe.reader("net/routes", Routes)
        async with operator.inviting(base, "uav1") as (token,):
            await operator.keys(vehicle, "join", token)
        async with spawn(vehicle, "broker"):
            await until(routes, "uav1")


async def test_root_invites_again_after_inviter_was_killed(tmp_path: Path) -> None:
    base, vehicle = make_node(tmp_path, "gcs"), make_node(tmp_path, "uav1")
    root, operator = tmp_path / "root", Operator(tmp_path / "root")
    await operator.keys(base, "init")
    process = await operator.start(base, "invite", "uav1", "--address", "127.0.0.1")
    assert process.stdout is not None
    async with asyncio.timeout(PATIENCE_S):
        token = (await process.stdout.readline()).decode().split()[3]
    process.send_signal(signal.SIGKILL)
    await process.communicate()
    refused = await operator.start(vehicle, "join", token)
    async with asyncio.timeout(PATIENCE_S):
        _, err = await refused.communicate()
    assert refused.returncode == 4 and b"no inviter answers" in err
    assert Root.load(root).roster.version == 1
    async with operator.inviting(base, "uav1") as (token,):
        joining = await operator.start(vehicle, "join", token)
        await ended(joining)
    assert Keys.load(vehicle.parent / "keys", "uav1").roster == Root.load(root).roster
