"""Reaping: the dead go, the living stay, and what is not ours is left alone."""

import os
from pathlib import Path

import pytest

from swarmware.model import paths
from swarmware.transport.shm.doorbell import Doorbell, DoorbellSenders
from swarmware.transport.shm.layout import readers_folder, ring_file
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.reap import reap, remove_all
from swarmware.transport.shm.ring import RingReader, RingWriter


@pytest.fixture
def shm_dir(tmp_path: Path) -> Path:
    return tmp_path / "shm"


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    return tmp_path / "run"


def names(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if not path.is_dir())


def test_missing_folders_are_clean(shm_dir: Path, run_dir: Path) -> None:
    assert reap(shm_dir, run_dir).removed == ()
    assert remove_all(shm_dir, run_dir).removed == ()


def test_dead_rings_go_and_living_stay(shm_dir: Path, run_dir: Path) -> None:
    dead = ring_file(shm_dir, "nav/pose")
    mirror = ring_file(shm_dir, "nav/pose", "uav3")
    RingWriter(dead, slots=4, slot_bytes=64).close()
    RingWriter(mirror, slots=4, slot_bytes=64).close()
    with (
        RingWriter(ring_file(shm_dir, "net/routes"), slots=4, slot_bytes=64) as living,
        RingReader(living.path) as reader,
        RingReader(dead) as stale,
    ):
        reaped = reap(shm_dir, run_dir)
        assert set(reaped.removed) == {dead, mirror}
        assert reaped.denied == ()
        assert names(shm_dir) == ["net.routes.ring"]
        assert stale.moved
        assert not reader.moved
        living.write(b"x")
        assert reader.newest() == b"x"


def test_table_stays_while_used(shm_dir: Path, run_dir: Path) -> None:
    doorbells = DoorbellSenders(paths.doorbells(run_dir))
    written, awaited, forgotten = (
        ring_file(shm_dir, path) for path in ("a/written", "b/awaited", "c/forgotten")
    )
    dead = Doorbell(paths.doorbells(run_dir))
    for path in (written, awaited, forgotten):
        with ReaderNotifier(readers_folder(path), doorbells) as bells:
            bells.add(dead.name)
    with RingWriter(written, slots=4, slot_bytes=64), Doorbell(paths.doorbells(run_dir)) as doorbell:
        with ReaderNotifier(readers_folder(awaited), doorbells) as bells:
            bells.add(doorbell.name)
        dead.close()
        assert reap(shm_dir, run_dir).removed == (readers_folder(forgotten),)
        with ReaderNotifier(readers_folder(awaited), doorbells) as bells:
            assert bells.names() == (doorbell.name,)
            bells.notify()
            assert doorbell.drain()
    assert set(reap(shm_dir, run_dir).removed) == {written, readers_folder(written), readers_folder(awaited)}
    assert names(shm_dir) == []
    doorbells.close()


def test_writer_whose_table_was_reaped_finds_next_reader(shm_dir: Path, run_dir: Path) -> None:
    doorbells = DoorbellSenders(paths.doorbells(run_dir))
    path = shm_dir / "apps.readers"  # a table without a ring
    with (
        ReaderNotifier(path, doorbells) as writer,
        ReaderNotifier(path, doorbells) as reader,
        Doorbell(paths.doorbells(run_dir)) as doorbell,
    ):
        writer.notify()
        assert reap(shm_dir, run_dir).removed == (path,)
        reader.add(doorbell.name)
        writer.notify()
        assert doorbell.drain()
    doorbells.close()


def test_dead_doorbells_go_and_living_stay(shm_dir: Path, run_dir: Path) -> None:
    with Doorbell(paths.doorbells(run_dir)) as doorbell:
        left = paths.doorbells(run_dir) / "17-0"
        os.mkfifo(left)
        assert reap(shm_dir, run_dir).removed == (left,)
        assert DoorbellSenders(paths.doorbells(run_dir)).ring(doorbell.name)


def test_a_file_that_was_never_finished_goes(shm_dir: Path, run_dir: Path) -> None:
    shm_dir.mkdir()
    for content in (b"", bytes(1000), b"SWARMRNG" + bytes(500)):
        path = shm_dir / "a.ring.new"
        path.write_bytes(content)
        assert reap(shm_dir, run_dir).removed == (path,)


def test_what_is_not_ours_is_left_alone(shm_dir: Path, run_dir: Path) -> None:
    (shm_dir / "sub").mkdir(parents=True)
    (paths.doorbells(run_dir)).mkdir(parents=True)
    (shm_dir / "their.ring").write_bytes(b"precious")
    (shm_dir / "their.ring.new").write_bytes(b"precious")
    (shm_dir / "their.readers").write_bytes(b"precious")
    (shm_dir / "sub" / "notes.txt").write_bytes(b"precious")
    (paths.doorbells(run_dir) / "notes").write_bytes(b"precious")
    os.mkfifo(shm_dir / "fifo.ring")
    (shm_dir / "link.ring").symlink_to(shm_dir / "their.ring")
    before = names(shm_dir), names(run_dir)
    assert reap(shm_dir, run_dir).removed == ()
    assert remove_all(shm_dir, run_dir).removed == ()
    assert (names(shm_dir), names(run_dir)) == before


def test_end_of_node_removes_everything_and_folders(shm_dir: Path, run_dir: Path) -> None:
    doorbells = DoorbellSenders(paths.doorbells(run_dir))
    ring = ring_file(shm_dir, "nav/pose", "uav1")
    with (
        RingWriter(ring, slots=4, slot_bytes=64),
        RingReader(ring) as reader,
        Doorbell(paths.doorbells(run_dir)) as doorbell,
        ReaderNotifier(readers_folder(ring), doorbells) as bells,
    ):
        bells.add(doorbell.name)
        assert len(remove_all(shm_dir, run_dir).removed) == 3
        assert reader.moved
        assert not shm_dir.exists()
        assert not (paths.doorbells(run_dir)).exists()
    assert not shm_dir.exists()
