"""Today's code on the files of a node that ran version 0.1: configuration, settings and logs are kept.

tests/data/node-0.1 was written by that version: a vehicle on whose way two settings were changed.
"""

import asyncio
import shutil
from pathlib import Path

import msgspec
import pytest
from tests.patience import PATIENCE_S

from swarmware.model.config import load_node, load_service
from swarmware.module.module import Module
from swarmware.recorder.query import FolderSource, Query
from swarmware.service.installed import find
from swarmware.testing.process import spawn
from swarmware.types.log import LogStats, LogStatsRequest
from swarmware.types.scalar import Float
from swarmware.types.tree import TreeSetDone, TreeUndo

OLD = Path(__file__).parents[2] / "data/node-0.1"
SETTINGS = {"altitude_kp": (1.2, 1.7), "position_kp": (1.0, 0.8)}
"""Settings that 0.1 changed: the default, and the value."""
ENTRIES = 405


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """The configuration folder of a copy of the node."""
    shutil.copytree(OLD, tmp_path, dirs_exist_ok=True)
    path = tmp_path / "etc/node.toml"
    path.write_text(path.read_text().replace("@FOLDER@", str(tmp_path)))
    return tmp_path / "etc"


def logged(folder: Path) -> list[tuple[str, int, msgspec.Struct | None]]:
    return [(entry.path, entry.utc_ns, entry.value()) for entry in FolderSource([folder]).entries(Query())]


def test_every_configuration_file_of_former_version_is_accepted(config: Path) -> None:
    services = load_node(config).services
    assert {path.stem for path in (config / "services").glob("*.toml")} | {"control"} == set(services)
    assert services[-2:] == ("control", "navigator"), "0.1 had no control; without it no chassis moves"
    for name in services:
        load_service(config, name, find(name).Config)


async def test_settings_keep_their_values_and_may_be_undone(config: Path) -> None:
    async with Module("reader", config_dir=config) as module:
        readers = {name: module.reader(f"config/navigator/{name}", Float) for name in SETTINGS}
        async with spawn(config, "tree", forked=False):
            for name, (default, value) in SETTINGS.items():
                assert await readers[name].changed(timeout_s=PATIENCE_S) == Float(value)
                path = f"/uav1/config/navigator/{name}"
                done = await module.request(
                    "sys/tree/undo", TreeUndo(path), TreeSetDone, timeout_s=PATIENCE_S
                )
                assert done.path == path
                async with asyncio.timeout(PATIENCE_S):
                    while readers[name].value != Float(default):
                        await readers[name].changed()


async def test_logs_are_read_and_continued(config: Path) -> None:
    folder = config.parent / "data/log"
    before = logged(folder)
    assert len(before) == ENTRIES
    async with Module("source", config_dir=config) as module:
        board = module.writer("test/value", Float, log="all")
        async with spawn(config, "logger", forked=False):
            board.write(Float(1.5))
            await module.request("sys/log/stats", LogStatsRequest(flush=True), LogStats, timeout_s=PATIENCE_S)
    after = logged(folder)
    assert after[:ENTRIES] == before
    assert ("test/value", Float(1.5)) in [(path, value) for path, _, value in after[ENTRIES:]]
