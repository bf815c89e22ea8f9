"""A setting has the value of its file until it is changed, and returns to it: who changed what is kept."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import NamedTuple

import msgspec
import pytest

from swarmd.tree.settings.settings import Settings
from swarmd.tree.settings.store import SettingsStore
from swarmware.errors import Conflict, InvalidInput, NotFound
from swarmware.model.resource import Kind, Resource
from swarmware.module.module import Module
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.appfile.entry import AppEntry
from swarmware.types.scalar import Float

KP = Resource(
    path="config/navigator/kp", kind=Kind.SETTING, type="Float", range=(0.0, 100.0), default=1.2, access="rw"
)
BOARD = Resource(path="nav/height", type="Float")


def navigator(kp: object, started_ns: int = 1) -> AppEntry:
    return AppEntry(
        name="navigator", instance=1, pid=2, pid_start=3, endpoint="ipc:///x", started_ns=started_ns,
        config={"altitude": {"kp_1_s": kp}}, live={"altitude.kp_1_s": "navigator/kp"},
    )  # fmt: skip


class Bench(NamedTuple):
    module: Module
    file: Path

    def settings(self) -> Settings:
        made = Settings(self.module, SettingsStore(self.file))
        made.publish([KP, BOARD])
        return made

    @property
    def value(self) -> float | None:
        found = self.module.reader(KP.path, Float).value
        return None if found is None else found.value


@asynccontextmanager
async def made(tmp_path: Path) -> AsyncIterator[Bench]:
    async with tmp_node(tmp_path) as node, Module("tree", node=node) as module:
        yield Bench(module, tmp_path / "settings.toml")


async def test_unchanged_setting_has_value_of_file(tmp_path: Path) -> None:
    async with made(tmp_path) as bench:
        settings = bench.settings()
        assert bench.value == 1.2, "no owner yet: the default of the template"
        settings.on_applications([navigator(1.5)])
        assert bench.value == 1.5
        settings.on_applications([navigator(1.7, started_ns=2)])
        assert bench.value == 1.7, "its file was changed, and its owner was restarted"
        assert settings.version(KP.path) == 0
        settings.close()
        assert not bench.file.exists()


async def test_file_value_beyond_range_is_shown(
    tmp_path: Path,
) -> None:
    async with made(tmp_path) as bench:
        settings = bench.settings()
        settings.on_applications([navigator(500.0)])
        assert bench.value == 500.0
        settings.on_applications([navigator("much", started_ns=2)])
        assert bench.value == 1.2
        settings.close()


async def test_override_survives_restarts_until_reset(
    tmp_path: Path,
) -> None:
    async with made(tmp_path) as bench:
        settings = bench.settings()
        settings.on_applications([navigator(1.5)])
        assert await settings.set(KP, Float(4.0), KP.path, "operator@gcs") == 1
        settings.on_applications([navigator(1.7, started_ns=2)])
        assert bench.value == 4.0
        settings.close()
        settings = bench.settings()
        settings.on_applications([navigator(1.7, started_ns=2)])
        assert bench.value == 4.0
        assert await settings.reset(KP, KP.path, "swarmctl@uav1") == (Float(1.7), 2)
        assert bench.value == 1.7
        assert await settings.reset(KP, KP.path, "swarmctl@uav1") == (Float(1.7), 2), "it has none any more"
        settings.on_applications([navigator(1.9, started_ns=3)])
        assert bench.value == 1.9
        settings.close()


async def test_owner_that_joins_gets_its_settings_written_again(tmp_path: Path) -> None:
    async with made(tmp_path) as bench:
        settings = bench.settings()
        settings.on_applications([navigator(1.5)])
        reader = bench.module.reader(KP.path, Float)
        before = reader.sequence
        settings.on_applications([navigator(1.5)])
        assert reader.sequence == before, "it has not joined again"
        settings.on_applications([navigator(1.5, started_ns=2)])
        assert reader.sequence == before + 1
        settings.close()


async def test_each_change_is_recorded_and_undone(tmp_path: Path) -> None:
    async with made(tmp_path) as bench:
        settings = bench.settings()
        settings.on_applications([navigator(1.5)])
        with pytest.raises(NotFound, match="nothing to undo"):
            await settings.undo(KP, KP.path, "operator@gcs")
        await settings.set(KP, Float(4.0), KP.path, "operator@gcs")
        await settings.set(KP, Float(5.0), KP.path, "maintainer@gcs")
        assert await settings.undo(KP, KP.path, "swarmctl@uav1") == (Float(4.0), 3)
        assert await settings.undo(KP, KP.path, "swarmctl@uav1") == (Float(5.0), 4), (
            "a second one restores it"
        )
        await settings.reset(KP, KP.path, "operator@gcs")
        found = [
            (one.by, one.before, one.after, one.overrode, one.overrides)
            for _, one in settings.changes(any_path)
        ]
        assert found == [
            ("operator@gcs", 5.0, 1.5, True, False),
            ("swarmctl@uav1", 4.0, 5.0, True, True),
            ("swarmctl@uav1", 5.0, 4.0, True, True),
            ("maintainer@gcs", 4.0, 5.0, True, True),
            ("operator@gcs", 1.5, 4.0, False, True),
        ]
        assert settings.changes(lambda path: path != KP.path) == []
        assert (await settings.undo(KP, KP.path, "operator@gcs"))[0] == Float(5.0)
        settings.close()


async def test_undo_of_the_first_change_removes_the_override(tmp_path: Path) -> None:
    async with made(tmp_path) as bench:
        settings = bench.settings()
        settings.on_applications([navigator(1.5)])
        await settings.set(KP, Float(4.0), KP.path, "operator@gcs")
        assert await settings.undo(KP, KP.path, "operator@gcs") == (Float(1.5), 2)
        settings.on_applications([navigator(1.7, started_ns=2)])
        assert bench.value == 1.7, "no override is left that would hide the file"
        settings.close()


async def test_setting_stored_by_version_0_1_undoes(tmp_path: Path) -> None:
    async with made(tmp_path) as bench:
        bench.file.write_text('["config/navigator/kp"]\nvalue = 1.7\nversion = 1\nbefore = 1.25\n')
        settings = bench.settings()
        assert bench.value == 1.7
        assert await settings.undo(KP, KP.path, "operator@gcs") == (Float(1.25), 2)
        assert [one.before for _, one in settings.changes(any_path)] == [1.7]
        settings.close()


async def test_a_refused_change_leaves_no_trace(tmp_path: Path) -> None:
    async with made(tmp_path) as bench:
        settings = bench.settings()
        with pytest.raises(Conflict, match=r"has version 0 \(1\.2\) now; expected 7"):
            await settings.set(KP, Float(4.0), KP.path, "operator@gcs", 7)
        other = msgspec.structs.replace(KP, path="config/navigator/ki")
        with pytest.raises(NotFound, match="is not in force"):
            await settings.set(other, Float(4.0), other.path, "operator@gcs")
        for verb in (settings.undo, settings.reset):
            with pytest.raises(InvalidInput, match="expected a setting"):
                await verb(BOARD, BOARD.path, "operator@gcs")
        assert settings.changes(any_path) == []
        assert bench.value == 1.2
        settings.close()


def any_path(_: str) -> bool:
    return True
