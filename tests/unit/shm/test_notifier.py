"""Doorbells and the tables of their readers, all in one process."""

import fcntl
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

import pytest

from swarmware.model.clock import utc_ns
from swarmware.transport.shm.doorbell import Doorbell, DoorbellSenders, open_sender
from swarmware.transport.shm.layout import RingFull
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.readers import ENTRIES
from swarmware.transport.shm.reap import reap, remove_all


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "bells"


@pytest.fixture
def doorbells(folder: Path) -> Iterator[DoorbellSenders]:
    doorbells = DoorbellSenders(folder)
    yield doorbells
    doorbells.close()


@pytest.fixture
def doorbell(folder: Path) -> Iterator[Doorbell]:
    with Doorbell(folder) as doorbell:
        yield doorbell


@pytest.fixture
def notifier(tmp_path: Path, doorbells: DoorbellSenders) -> Iterator[ReaderNotifier]:
    """The writer's."""
    with ReaderNotifier(tmp_path / "nav.pose.readers", doorbells) as notifier:
        yield notifier


@pytest.fixture
def others(tmp_path: Path, doorbells: DoorbellSenders) -> Iterator[ReaderNotifier]:
    """The readers'."""
    with ReaderNotifier(tmp_path / "nav.pose.readers", doorbells) as notifier:
        yield notifier


def test_a_bell_rings_until_it_is_drained(
    doorbell: Doorbell,
    doorbells: DoorbellSenders,
) -> None:
    assert not doorbell.drain()
    assert not doorbell.wait(0.0)
    assert doorbells.ring(doorbell.name)
    assert doorbells.ring(doorbell.name)
    assert doorbell.wait(5.0)
    assert not doorbell.drain()


def test_unanswered_bell_never_stops_its_ringer(doorbell: Doorbell, doorbells: DoorbellSenders) -> None:
    for _ in range(20_000):
        assert doorbells.ring(doorbell.name)
    assert doorbell.drain()
    assert not doorbell.drain()


def test_two_bells_of_one_process_have_two_names(
    folder: Path, doorbell: Doorbell, doorbells: DoorbellSenders
) -> None:
    with Doorbell(folder) as second:
        assert second.name != doorbell.name
        assert doorbells.ring(second.name)
        assert second.drain()
        assert not doorbell.drain()
    assert not doorbells.ring(second.name)


def test_bell_of_dead_namesake_is_replaced(folder: Path) -> None:
    folder.mkdir()
    os.mkfifo(folder / f"{os.getpid()}-0")
    with Doorbell(folder) as doorbell:
        assert doorbell.name == f"{os.getpid()}-0"
    assert list(folder.iterdir()) == []


def test_recreated_bell_of_same_name_is_found(folder: Path, doorbells: DoorbellSenders) -> None:
    first = Doorbell(folder)
    assert doorbells.ring(first.name)
    first.close()
    first.close()
    with Doorbell(folder) as second:
        assert second.name == first.name
        assert doorbells.ring(second.name)
        assert second.drain()


def test_non_bell_file_is_not_written(
    folder: Path,
    doorbells: DoorbellSenders,
) -> None:
    folder.mkdir()
    (folder / "17-0").write_bytes(b"untouched")
    assert not doorbells.ring("17-0")
    assert open_sender(folder / "17-0") is None
    assert (folder / "17-0").read_bytes() == b"untouched"


def test_the_writer_wakes_those_who_asked_for_it(
    notifier: ReaderNotifier, others: ReaderNotifier, doorbell: Doorbell
) -> None:
    notifier.notify()
    assert not doorbell.drain()
    others.add(doorbell.name)
    others.add(doorbell.name)
    notifier.notify()
    assert doorbell.drain()
    assert notifier.names() == (doorbell.name,)
    others.remove(doorbell.name)
    notifier.notify()
    assert not doorbell.drain()


def test_a_reader_may_come_before_the_writer(
    tmp_path: Path, doorbells: DoorbellSenders, doorbell: Doorbell
) -> None:
    path = tmp_path / "later" / "nav.pose.readers"
    with ReaderNotifier(path, doorbells) as reader:
        reader.add(doorbell.name)
    with ReaderNotifier(path, doorbells) as writer:
        writer.notify()
    assert doorbell.drain()


def test_dead_are_dropped_and_living_still_rung(
    notifier: ReaderNotifier, others: ReaderNotifier, folder: Path
) -> None:
    with Doorbell(folder) as living:
        dead = Doorbell(folder)
        others.add(dead.name)
        others.add(living.name)
        notifier.notify()
        assert dead.drain()
        assert living.drain()
        dead.close()
        notifier.notify()
        assert living.drain()
        assert others.names() == (living.name,)


def test_sixty_four_may_read_and_dead_make_room(others: ReaderNotifier, folder: Path) -> None:
    doorbells = [Doorbell(folder) for _ in range(ENTRIES + 1)]
    for doorbell in doorbells[:ENTRIES]:
        others.add(doorbell.name)
    with pytest.raises(RingFull, match="64 processes of this user read this ring"):
        others.add(doorbells[ENTRIES].name)
    doorbells[5].close()
    others.add(doorbells[ENTRIES].name)
    assert len(others.names()) == ENTRIES
    assert doorbells[5].name not in others.names()
    for doorbell in doorbells:
        doorbell.close()


def test_folder_locked_by_stopped_process_blocks_none(
    notifier: ReaderNotifier, others: ReaderNotifier, folder: Path
) -> None:
    with Doorbell(folder) as living, Doorbell(folder) as dead:
        others.add(living.name)
        others.add(dead.name)
        notifier.notify()
        living.drain()
        dead.close()
        fd = os.open(notifier.path, os.O_RDONLY)
        fcntl.flock(fd, fcntl.LOCK_EX)
        notifier.notify()
        assert living.drain()
        assert others.names() == (living.name,)
        with Doorbell(folder) as third:
            others.add(third.name)
            notifier.notify()
            assert third.drain()
        os.close(fd)


def test_removed_empty_folder_is_reopened(
    notifier: ReaderNotifier, others: ReaderNotifier, doorbell: Doorbell
) -> None:
    notifier.notify()
    os.utime(notifier.path, ns=(1, 1))
    notifier.notify()
    notifier.path.rmdir()  # which does not change its time
    others.add(doorbell.name)
    notifier.notify()
    assert doorbell.drain()


def test_folder_that_left_its_path_is_opened_again(
    notifier: ReaderNotifier, others: ReaderNotifier, doorbell: Doorbell
) -> None:
    notifier.notify()
    notifier.path.rmdir()
    others.add(doorbell.name)
    notifier.notify()
    assert doorbell.drain()


def test_readers_within_kernel_tick_are_all_woken(
    notifier: ReaderNotifier, others: ReaderNotifier, folder: Path
) -> None:
    doorbells = [Doorbell(folder) for _ in range(40)]
    for doorbell in doorbells:
        others.add(doorbell.name)
        notifier.notify()
        assert doorbell.drain()
    for doorbell in doorbells:
        doorbell.close()


def test_doorbell_entered_before_first_frame_is_rung(
    notifier: ReaderNotifier, doorbell: Doorbell, monkeypatch: pytest.MonkeyPatch
) -> None:
    # between the entry and its listing the process stands still for a second
    monkeypatch.setattr("swarmware.transport.shm.readers.utc_ns", lambda: utc_ns() + 1_000_000_000)
    notifier.add(doorbell.name)
    notifier.notify()
    assert doorbell.drain()


def test_dropped_name_is_rung_again_when_reentered(
    notifier: ReaderNotifier, others: ReaderNotifier, folder: Path
) -> None:
    with Doorbell(folder) as first:
        others.add(first.name)
    notifier.notify()
    with Doorbell(folder) as second:
        assert second.name == first.name
        (notifier.path / second.name).touch()  # as if dropping it had failed
        others.add(second.name)
        notifier.notify()
        assert second.drain()


def test_removal_from_missing_folder_creates_none(notifier: ReaderNotifier, doorbell: Doorbell) -> None:
    notifier.remove(doorbell.name)
    assert not notifier.path.exists()


@pytest.mark.parametrize("kind", ["empty", "garbage", "table of an older version", "link", "fifo"])
def test_obstacle_at_folders_path_gives_way(
    tmp_path: Path, notifier: ReaderNotifier, doorbell: Doorbell, others: ReaderNotifier, kind: str
) -> None:
    target = tmp_path / "target"
    target.write_bytes(b"untouched")
    match kind:
        case "link":
            notifier.path.symlink_to(target)
        case "fifo":
            os.mkfifo(notifier.path)
        case "empty":
            notifier.path.touch()
        case "garbage":
            notifier.path.write_bytes(Random(1).randbytes(4096))
        case _:
            notifier.path.write_bytes(b"SWBELLS\0".ljust(4096, b"\0"))
    notifier.notify()
    others.add(doorbell.name)
    notifier.notify()
    assert doorbell.drain()
    assert target.read_bytes() == b"untouched"


STRANGE: list[Callable[[Path], object]] = [
    os.mkfifo,
    os.mkdir,
    lambda path: (path / "inner").mkdir(parents=True),
    lambda path: path.symlink_to("x"),
]


@pytest.mark.parametrize("make", STRANGE, ids=["fifo", "folder", "full", "link"])
def test_non_entry_stops_neither_writer_nor_reader(
    notifier: ReaderNotifier,
    others: ReaderNotifier,
    doorbell: Doorbell,
    make: Callable[[Path], object],
) -> None:
    others.add("17-0")  # makes the folder
    others.remove("17-0")
    make(notifier.path / "18-0")
    make(notifier.path / doorbell.name)
    notifier.notify()
    assert notifier.names() == ()
    others.add(doorbell.name)
    notifier.notify()
    assert notifier.names() == (doorbell.name,)
    assert doorbell.drain()
    others.remove("18-0")
    assert not (notifier.path / "18-0").exists()


@pytest.mark.parametrize("make", STRANGE, ids=["fifo", "folder", "full", "link"])
@pytest.mark.parametrize("sweep", [reap, remove_all])
def test_non_entry_stops_neither_start_nor_end(
    tmp_path: Path, make: Callable[[Path], object], sweep: Callable[[Path, Path], object]
) -> None:
    table = tmp_path / "shm/nav.pose.readers"
    table.mkdir(parents=True)
    (tmp_path / "run/bells").mkdir(parents=True)
    make(table / "18-0")
    make(tmp_path / "run/bells/19-0")
    for _ in range(2):
        sweep(tmp_path / "shm", tmp_path / "run")
    assert not (table / "18-0").exists()
