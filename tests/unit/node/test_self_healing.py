"""Damaged or removed files of a process in shared memory are replaced, and logged once."""

import asyncio
import logging
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.patience import PATIENCE_S, until

from swarmware.errors import OutOfRange
from swarmware.module.module import Module
from swarmware.node import node as node_module
from swarmware.node.node import Node
from swarmware.node.publication import Publication
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.shm.layout import readers_folder, ring_file
from swarmware.types.scalar import Float


@pytest.fixture(autouse=True)
def _often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(node_module, "TEND_NS", 10_000_000)
    monkeypatch.setattr(node_module, "TEND_PHASE_NS", 0)


def remove(path: Path) -> None:
    path.unlink()


def cut(path: Path) -> None:
    with path.open("r+b") as file:
        file.truncate(16)


def overwrite(path: Path) -> None:
    with path.open("r+b") as file:
        file.write(b"\xff" * 64)


@pytest.mark.parametrize("damage", [remove, overwrite])
async def test_damaged_board_is_replaced_with_its_newest_value(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, damage: Callable[[Path], None]
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        writer, ring = m.writer("nav/height", Float), ring_file(node.shm_dir, "nav/height")
        writer.write(Float(1.0))
        writer.write(Float(2.0))
        damage(ring)
        await until(lambda: "damaged or removed; replaced" in caplog.text)
        reader = m.reader("nav/height", Float)
        assert (reader.value, reader.sequence) == (Float(2.0), 2)
        writer.write(Float(3.0))
        assert (reader.value, reader.sequence) == (Float(3.0), 3), "the sequence goes on"


def swap(path: Path) -> None:
    copy = path.with_suffix(".copy")
    copy.write_bytes(path.read_bytes())
    copy.rename(path)


@pytest.mark.parametrize("damage", [remove, cut, overwrite, swap])
async def test_file_is_resolved_only_after_folder_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damage: Callable[[Path], None]
) -> None:
    tended: list[tuple[bool, bool]] = []
    tend = Publication.tend

    def recorded(self: Publication, *, at_path: bool) -> bool:
        replaced = tend(self, at_path=at_path)
        tended.append((at_path, replaced))
        return replaced

    async with tmp_node(tmp_path) as node:
        made = node.publication("nav/height", slots=4, slot_bytes=256)
        monkeypatch.setattr(Publication, "tend", recorded)
        await until(lambda: (True, False) in tended)
        damage(made.path)
        await until(lambda: any(replaced for _, replaced in tended))
        tended.clear()
        await until(lambda: (True, False) in tended)
        assert not any(replaced for _, replaced in tended)
        made.close()


async def test_a_reader_goes_on_over_the_replacement(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        writer, reader = m.writer("nav/height", Float), m.reader("nav/height", Float)
        writer.write(Float(1.0))
        assert await reader.changed(PATIENCE_S) == Float(1.0)
        waiting = asyncio.create_task(reader.changed(20.0))
        await asyncio.sleep(0)
        ring_file(node.shm_dir, "nav/height").unlink()
        await until(ring_file(node.shm_dir, "nav/height").exists)
        writer.write(Float(2.0))
        assert await waiting == Float(2.0)


async def test_removed_doorbell_entry_is_remade_without_loss(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        writer, reader = m.writer("nav/height", Float), m.reader("nav/height", Float)
        waiting = asyncio.create_task(reader.changed(20.0))
        await asyncio.sleep(0)
        entries = readers_folder(ring_file(node.shm_dir, "nav/height"))
        own = entries / node.doorbell.name
        assert own.exists()
        own.unlink()
        writer.write(Float(1.0))  # rings for nobody
        assert await waiting == Float(1.0)
        await until(own.exists)
        assert "our entry was removed; entered again" in caplog.text


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), OutOfRange("too many files")])
async def test_irreplaceable_entry_is_logged_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, error: Exception
) -> None:
    looked = 0

    def tend(self: Publication, *, at_path: bool) -> bool:
        nonlocal looked
        looked += 1
        raise error

    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        m.writer("nav/height", Float)
        monkeypatch.setattr(Publication, "tend", tend)
        await until(lambda: looked > 8)
        monkeypatch.undo()
        errors = [one.getMessage() for one in caplog.records if one.levelno == logging.ERROR]
        assert len([text for text in errors if "nav.height" in text]) == 1
        assert all("cannot be replaced" in text and str(error) in text for text in errors)


async def test_unrecreatable_entry_is_logged_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    tried = 0

    def enter(self: Node, readers: Path) -> None:
        nonlocal tried
        tried += 1
        raise OSError(28, "No space left on device")

    async with tmp_node(tmp_path) as node, Module("planner", node=node) as m:
        reader = m.reader("nav/height", Float)
        reader.listen()
        entries = readers_folder(ring_file(node.shm_dir, "nav/height"))
        monkeypatch.setattr(Node, "_enter", enter)
        shutil.rmtree(entries)
        await until(lambda: tried > 5)
        monkeypatch.undo()
        errors = [one for one in caplog.records if "cannot be made again" in one.getMessage()]
        assert len(errors) == 1
        await until((entries / node.doorbell.name).exists)
