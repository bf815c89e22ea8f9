"""The record of changes: who asked for what, found by filters, kept over starts, bounded."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

from swarmd.tree.records import change_log
from swarmd.tree.records.change_log import ChangeLog
from swarmware.errors import InvalidInput
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.tree import TreeChange, TreeLog, TreeLogQuery


class Bench(NamedTuple):
    client: Module
    log: ChangeLog

    async def ask(self, query: TreeLogQuery) -> TreeLog:
        return await self.client.request("sys/tree/log", query, TreeLog, timeout_s=30)

    async def paths(self, query: TreeLogQuery) -> list[str]:
        return [one.change.path for one in (await self.ask(query)).changes]


@asynccontextmanager
async def made(tmp_path: Path, file: Path) -> AsyncIterator[Bench]:
    async with (
        tmp_node(tmp_path) as node,
        Module("tree", node=node) as tree,
        Module("client", node=node) as client,
    ):
        changes = tree.stream_writer("tree/changes", TreeChange, kind="event", link="request")
        log = ChangeLog(tree, changes, file)
        log.serve()
        node.table.refresh()
        yield Bench(client, log)


def change(path: str, by: str = "operator@gcs", refused: str = "") -> TreeChange:
    return TreeChange(f"/uav1/{path}", by, "[1.0]", "" if refused else "[2.0]", refused)


async def test_changes_are_found_by_all_filters(tmp_path: Path) -> None:
    async with made(tmp_path, tmp_path / "changes.jsonl") as bench:
        await bench.log.record(change("config/a"))
        await bench.log.record(change("config/b", "observer@uav2", "expected role operator"))
        await bench.log.record(change("cmd/goto", "swarmctl#1@uav1"))
        everything = await bench.ask(TreeLogQuery())
        assert [one.change.path for one in everything.changes] == [
            "/uav1/cmd/goto",
            "/uav1/config/b",
            "/uav1/config/a",
        ]
        assert everything.platform == "uav1"
        assert await bench.paths(TreeLogQuery("config/*")) == ["/uav1/config/b", "/uav1/config/a"]
        assert await bench.paths(TreeLogQuery(by="@uav2")) == ["/uav1/config/b"]
        assert await bench.paths(TreeLogQuery(refused=True)) == ["/uav1/config/b"]
        newest = everything.changes[0]
        assert await bench.paths(TreeLogQuery(since_utc_ns=newest.utc_ns)) == ["/uav1/cmd/goto"]
        short = await bench.ask(TreeLogQuery(limit=1))
        assert (short.changes, short.more) == ((newest,), 2)
        with pytest.raises(InvalidInput):
            await bench.ask(TreeLogQuery("{"))


async def test_changes_of_pattern_rules_are_found(tmp_path: Path) -> None:
    async with made(tmp_path, tmp_path / "changes.jsonl") as bench:
        for path in ("config/a", "test/{height,depth}/*", "power/**", "no pattern{"):
            await bench.log.record(change(path))
        rule, deep = "/uav1/test/{height,depth}/*", "/uav1/power/**"
        assert await bench.paths(TreeLogQuery()) == ["/uav1/no pattern{", deep, rule, "/uav1/config/a"]
        assert await bench.paths(TreeLogQuery("test/**")) == [rule]
        assert await bench.paths(TreeLogQuery("test/{height,depth}/*")) == [rule], "the rule itself"
        assert await bench.paths(TreeLogQuery("test/depth/x")) == [rule], "a resource that it is about"
        assert await bench.paths(TreeLogQuery("power/battery")) == [deep]
        assert await bench.paths(TreeLogQuery("nav/*")) == []


async def test_changes_survive_crash_in_last_line(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = tmp_path / "data" / "changes.jsonl"
    async with made(tmp_path / "one", file) as bench:
        await bench.log.record(change("config/a"))
        await bench.log.record(change("config/b"))
    file.write_bytes(file.read_bytes() + b'[17,["/uav1/con')
    with caplog.at_level(logging.WARNING):
        async with made(tmp_path / "two", file) as bench:
            await bench.log.record(change("config/c"))
            assert len((await bench.ask(TreeLogQuery())).changes) == 3
    assert "1 lines cannot be read" in caplog.text
    async with made(tmp_path / "three", file) as bench:
        assert await bench.paths(TreeLogQuery("config/*")) == [
            f"/uav1/config/{name}" for name in ("c", "b", "a")
        ], "a line after the cut one is whole"


async def test_record_is_bounded_on_disk_and_keeps_newest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(change_log, "FILE_BYTES", 1000)
    file = tmp_path / "data" / "changes.jsonl"
    async with made(tmp_path / "one", file) as bench:
        await asyncio.gather(*(bench.log.record(change(f"config/k{number}")) for number in range(60)))
    assert sorted(one.name for one in file.parent.iterdir()) == ["changes.1.jsonl", "changes.jsonl"]
    assert sum(one.stat().st_size for one in file.parent.iterdir()) <= 2000
    async with made(tmp_path / "two", file) as bench:
        kept = await bench.paths(TreeLogQuery())
        assert kept[0] == "/uav1/config/k59"
        assert 5 < len(kept) < 60


async def test_refusing_disk_is_named_and_change_answered(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "data"
    file.write_text("a file where the folder should be")
    with caplog.at_level(logging.WARNING):
        async with made(tmp_path / "one", file / "changes.jsonl") as bench:
            await bench.log.record(change("config/a"))
            assert await bench.paths(TreeLogQuery()) == ["/uav1/config/a"]
    assert "is not on the disk" in caplog.text
