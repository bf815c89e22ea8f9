"""The applications of a node: each change reaches every subscriber once, whoever looked first."""

import asyncio
import os
from pathlib import Path

import msgspec
from tests.patience import PATIENCE_S

from swarmware.node.applications import ApplicationEvent, Change
from swarmware.node.node import Node
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.appfile.file import AppFile


class Seen:
    """Events of one subscriber."""

    def __init__(self, node: Node) -> None:
        self._arrived = asyncio.Event()
        self.changes: list[tuple[Change, str]] = []
        self.subscription = node.applications.subscribe(self._on_events)

    def _on_events(self, events: list[ApplicationEvent]) -> None:
        self.changes += [(event.change, event.entry.id) for event in events]
        self._arrived.set()

    async def take(self) -> list[tuple[Change, str]]:
        """What has come since the last call; waits for it."""
        async with asyncio.timeout(PATIENCE_S):
            await self._arrived.wait()
        self._arrived.clear()
        changes, self.changes = self.changes, []
        return changes


def join(node: Node, name: str) -> AppFile:
    return AppFile(node.run_dir, name, endpoint="ipc://x", started_ns=1, announce=node.announce_apps)


async def test_subscriber_gets_each_change_once_despite_others(
    tmp_path: Path,
) -> None:
    async with tmp_node(tmp_path) as node:
        one, other = Seen(node), Seen(node)
        app = join(node, "planner")
        node.table.refresh()  # whoever looks first takes nothing from the others
        for seen in (one, other):
            assert await seen.take() == [(Change.JOINED, "planner#1")]
        app.write(msgspec.structs.replace(app.entry, reads=("/*/nav/pose",)))
        for seen in (one, other):
            assert await seen.take() == [(Change.CHANGED, "planner#1")]
        app.close()
        for seen in (one, other):
            assert await seen.take() == [(Change.LEFT, "planner#1")]
        one.subscription.close()
        other.subscription.close()


async def test_owner_leaving_its_file_has_died(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        app = join(node, "planner")
        seen = Seen(node)
        os.close(app._fd)  # as the kernel does at the end of a process
        node.applications.refresh(probe=True)
        assert await seen.take() == [(Change.DIED, "planner#1")]
        seen.subscription.close()


async def test_replaced_application_has_left_and_joined(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        app = join(node, "planner")
        seen = Seen(node)
        app.write(msgspec.structs.replace(app.entry, pid=app.entry.pid + 1))
        node.applications.refresh()
        assert await seen.take() == [(Change.LEFT, "planner#1"), (Change.JOINED, "planner#1")]
        seen.subscription.close()
        app.close()


async def test_late_subscriber_gets_only_later_changes(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        early = Seen(node)
        first = join(node, "first")
        node.table.refresh()
        late = Seen(node)
        assert [entry.id for entry in node.applications.table] == ["first#1"]
        second = join(node, "second")
        node.applications.refresh()
        assert early.changes == [(Change.JOINED, "first#1"), (Change.JOINED, "second#1")]
        assert late.changes == [(Change.JOINED, "second#1")]
        early.subscription.close()
        late.subscription.close()
        second.close()
        first.close()


async def test_ended_subscription_delivers_nothing(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node:
        seen = Seen(node)
        app = join(node, "planner")
        node.table.refresh()  # the event is on its way
        seen.subscription.close()
        seen.subscription.close()
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert seen.changes == []
        app.close()
