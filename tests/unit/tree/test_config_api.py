"""The node answers for its configuration: files, what services have read, and live settings."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pytest

from swarmd.navigator.config import Config
from swarmd.navigator.service import Navigator
from swarmd.tree.operator.config_api import ConfigApi
from swarmd.tree.settings.settings import Settings
from swarmd.tree.settings.store import SettingsStore
from swarmware.errors import InvalidInput
from swarmware.model.config import load_service
from swarmware.model.resource import Kind, Resource
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.config import ConfigHistory, ConfigKey, ConfigQuery, EffectiveConfig, HistoryQuery
from swarmware.types.scalar import Float

KP = Resource(
    path="config/navigator/altitude_kp", kind=Kind.SETTING, type="Float", unit="1/s", range=(0.0, 100.0),
    default=1.2, access="rw",
)  # fmt: skip


class Bench(NamedTuple):
    client: Module
    settings: Settings
    folder: Path

    async def keys(self, pattern: str) -> dict[str, ConfigKey]:
        found = await self.client.request(
            "sys/node/config", ConfigQuery(pattern), EffectiveConfig, timeout_s=30
        )
        assert found.platform == "uav1"
        return {key.name: key for key in found.keys}


@asynccontextmanager
async def made(tmp_path: Path) -> AsyncIterator[Bench]:
    services: dict[str, Any] = {"navigator": {"altitude": {"kp_1_s": 1.5}}, "timesync": {}}
    async with tmp_node(tmp_path, services=services) as node:
        config = load_service(node.config_dir, "navigator", Config)
        live = Navigator.live_settings
        async with (
            Module("tree", node=node) as tree,
            Module("navigator", node=node, config=config, live_settings=live) as navigator,
        ):
            settings = Settings(tree, SettingsStore(tmp_path / "settings.toml"))
            settings.publish([KP])
            node.table.refresh()
            settings.on_applications(node.table)
            ConfigApi(tree, settings).serve()
            yield Bench(navigator, settings, node.config_dir)
            settings.close()


def plain(data: bytes) -> Any:
    return msgspec.msgpack.decode(data)


async def test_answer_has_files_running_services_and_live_settings(tmp_path: Path) -> None:
    async with made(tmp_path) as bench:
        found = await bench.keys("**")
        kp = found["navigator/altitude_kp"]
        assert (plain(kp.value), kp.origin, kp.live, kp.running) == (1.5, "file", True, True)
        assert not found["navigator/altitude_ki"].live, "this tree has no such setting"
        assert (found["timesync/window_s"].running, found["node/platform"].running) == (False, True)
        assert not any(key.pending for key in found.values())
        await bench.settings.set(KP, Float(4.0), KP.path, "operator@gcs")
        file = bench.folder / "services/navigator.toml"
        file.write_text(file.read_text().replace("1.5", "1.75"))
        kp = (await bench.keys("navigator/altitude.kp_1_s"))["navigator/altitude_kp"]
        assert (plain(kp.value), kp.origin, plain(kp.file_value), kp.pending) == (4.0, "live", 1.75, True)
        assert (kp.by, kp.version) == ("operator@gcs", 1)


async def test_the_history_is_answered_by_pattern(tmp_path: Path) -> None:
    async with made(tmp_path) as bench:
        await bench.settings.set(KP, Float(4.0), KP.path, "operator@gcs")
        await bench.settings.reset(KP, KP.path, "swarmctl@uav1")

        async def history(pattern: str) -> list[tuple[Any, ...]]:
            query = HistoryQuery(pattern)
            found = await bench.client.request("sys/tree/history", query, ConfigHistory, timeout_s=30)
            return [
                (one.name, one.by, plain(one.before), plain(one.after), one.overrode, one.overrides)
                for one in found.changes
            ]

        assert await history("navigator/*") == [
            ("navigator/altitude_kp", "swarmctl@uav1", 4.0, 1.5, True, False),
            ("navigator/altitude_kp", "operator@gcs", 1.5, 4.0, False, True),
        ]
        assert await history("broker/*") == []


async def test_a_pattern_that_is_none_is_refused(tmp_path: Path) -> None:
    async with made(tmp_path) as bench:
        for path, query, reply in (
            ("sys/node/config", ConfigQuery("a/[b]"), EffectiveConfig),
            ("sys/tree/history", HistoryQuery("a/[b]"), ConfigHistory),
        ):
            with pytest.raises(InvalidInput):
                await bench.client.request(path, query, reply, timeout_s=30)
