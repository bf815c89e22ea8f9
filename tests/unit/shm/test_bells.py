"""Doorbells and the tables of those who want to hear them, all in one process."""

import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmware.shm.bells import Bells
from swarmware.shm.doorbell import BellPulls, Doorbell, open_bell
from swarmware.shm.layout import RingFull
from swarmware.shm.readers import ENTRIES


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "bells"


@pytest.fixture
def pulls(folder: Path) -> Iterator[BellPulls]:
    pulls = BellPulls(folder)
    yield pulls
    pulls.close()


@pytest.fixture
def doorbell(folder: Path) -> Iterator[Doorbell]:
    with Doorbell(folder) as doorbell:
        yield doorbell


@pytest.fixture
def bells(tmp_path: Path, pulls: BellPulls) -> Iterator[Bells]:
    """The writer's."""
    with Bells(tmp_path / "nav.pose.readers", pulls) as bells:
        yield bells


@pytest.fixture
def others(tmp_path: Path, pulls: BellPulls) -> Iterator[Bells]:
    """The readers'."""
    with Bells(tmp_path / "nav.pose.readers", pulls) as bells:
        yield bells


def test_a_bell_rings_until_it_is_drained(doorbell: Doorbell, pulls: BellPulls) -> None:
    assert not doorbell.drain()
    assert not doorbell.wait(0.0)
    assert pulls.ring(doorbell.name)
    assert pulls.ring(doorbell.name)
    assert doorbell.wait(5.0)
    assert not doorbell.drain()


def test_a_bell_nobody_answers_never_stops_who_rings_it(doorbell: Doorbell, pulls: BellPulls) -> None:
    for _ in range(20_000):
        assert pulls.ring(doorbell.name)
    assert doorbell.drain()
    assert not doorbell.drain()


def test_two_bells_of_one_process_have_two_names(folder: Path, doorbell: Doorbell, pulls: BellPulls) -> None:
    with Doorbell(folder) as second:
        assert second.name != doorbell.name
        assert pulls.ring(second.name)
        assert second.drain()
        assert not doorbell.drain()
    assert not pulls.ring(second.name)


def test_a_bell_left_by_a_dead_process_of_our_number_is_replaced(folder: Path) -> None:
    folder.mkdir()
    os.mkfifo(folder / f"{os.getpid()}-0")
    with Doorbell(folder) as doorbell:
        assert doorbell.name == f"{os.getpid()}-0"
    assert list(folder.iterdir()) == []


def test_a_bell_made_again_under_the_same_name_is_found_again(folder: Path, pulls: BellPulls) -> None:
    first = Doorbell(folder)
    assert pulls.ring(first.name)
    first.close()
    first.close()
    with Doorbell(folder) as second:
        assert second.name == first.name
        assert pulls.ring(second.name)
        assert second.drain()


def test_a_file_that_is_no_bell_is_not_written_to(folder: Path, pulls: BellPulls) -> None:
    folder.mkdir()
    (folder / "17-0").write_bytes(b"untouched")
    assert not pulls.ring("17-0")
    assert open_bell(folder / "17-0") is None
    assert (folder / "17-0").read_bytes() == b"untouched"


def test_the_writer_wakes_those_who_asked_for_it(bells: Bells, others: Bells, doorbell: Doorbell) -> None:
    bells.ring()
    assert not doorbell.drain()
    others.add(doorbell.name)
    others.add(doorbell.name)
    bells.ring()
    assert doorbell.drain()
    assert bells.names() == (doorbell.name,)
    others.remove(doorbell.name)
    bells.ring()
    assert not doorbell.drain()


def test_a_reader_may_come_before_the_writer(tmp_path: Path, pulls: BellPulls, doorbell: Doorbell) -> None:
    path = tmp_path / "later" / "nav.pose.readers"
    with Bells(path, pulls) as reader:
        reader.add(doorbell.name)
    with Bells(path, pulls) as writer:
        writer.ring()
    assert doorbell.drain()


def test_the_dead_are_dropped_and_the_living_still_rung(bells: Bells, others: Bells, folder: Path) -> None:
    with Doorbell(folder) as living:
        dead = Doorbell(folder)
        others.add(dead.name)
        others.add(living.name)
        bells.ring()
        assert dead.drain()
        assert living.drain()
        dead.close()
        bells.ring()
        assert living.drain()
        assert others.names() == (living.name,)


def test_sixty_four_processes_may_read_and_the_dead_make_room(others: Bells, folder: Path) -> None:
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


def test_a_folder_locked_by_a_stopped_process_stops_neither_writer_nor_reader(
    bells: Bells, others: Bells, folder: Path
) -> None:
    with Doorbell(folder) as living, Doorbell(folder) as dead:
        others.add(living.name)
        others.add(dead.name)
        bells.ring()
        living.drain()
        dead.close()
        fd = os.open(bells.path, os.O_RDONLY)
        fcntl.flock(fd, fcntl.LOCK_EX)
        bells.ring()
        assert living.drain()
        assert others.names() == (living.name,)
        with Doorbell(folder) as third:
            others.add(third.name)
            bells.ring()
            assert third.drain()
        os.close(fd)


def test_a_folder_that_left_its_path_is_opened_again(bells: Bells, others: Bells, doorbell: Doorbell) -> None:
    bells.ring()
    bells.path.rmdir()
    others.add(doorbell.name)
    bells.ring()
    assert doorbell.drain()


def test_every_reader_that_comes_within_a_tick_of_the_kernel_is_woken(
    bells: Bells, others: Bells, folder: Path
) -> None:
    doorbells = [Doorbell(folder) for _ in range(40)]
    for doorbell in doorbells:
        others.add(doorbell.name)
        bells.ring()
        assert doorbell.drain()
    for doorbell in doorbells:
        doorbell.close()


def test_a_name_that_the_writer_has_dropped_is_rung_again_when_it_is_entered_again(
    bells: Bells, others: Bells, folder: Path
) -> None:
    with Doorbell(folder) as first:
        others.add(first.name)
    bells.ring()
    with Doorbell(folder) as second:
        assert second.name == first.name
        (bells.path / second.name).touch()  # as if dropping it had failed
        others.add(second.name)
        bells.ring()
        assert second.drain()


def test_removing_from_a_folder_that_is_gone_makes_none(bells: Bells, doorbell: Doorbell) -> None:
    bells.remove(doorbell.name)
    assert not bells.path.exists()


@pytest.mark.parametrize("kind", ["empty", "garbage", "table of an older version", "link", "fifo"])
def test_what_stands_in_the_place_of_the_folder_gives_way_to_it(
    tmp_path: Path, bells: Bells, doorbell: Doorbell, others: Bells, kind: str
) -> None:
    target = tmp_path / "target"
    target.write_bytes(b"untouched")
    match kind:
        case "link":
            bells.path.symlink_to(target)
        case "fifo":
            os.mkfifo(bells.path)
        case "empty":
            bells.path.touch()
        case "garbage":
            bells.path.write_bytes(os.urandom(4096))
        case _:
            bells.path.write_bytes(b"SWBELLS\0".ljust(4096, b"\0"))
    bells.ring()
    others.add(doorbell.name)
    bells.ring()
    assert doorbell.drain()
    assert target.read_bytes() == b"untouched"
