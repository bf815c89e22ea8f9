"""A ring whose file is damaged or removed under its living writer is replaced by it; readers go on."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

import pytest

from swarmware.node.publication import Publication
from swarmware.transport.shm import layout
from swarmware.transport.shm.doorbell import DoorbellSenders
from swarmware.transport.shm.ring import RingReader


@pytest.fixture
def publication(tmp_path: Path) -> Iterator[Publication]:
    doorbells = DoorbellSenders(tmp_path / "bells")
    made = Publication(tmp_path / "nav.pose.ring", doorbells, slots=4, slot_bytes=64)
    yield made
    made.close()
    doorbells.close()


def test_a_whole_ring_is_left_alone(publication: Publication) -> None:
    publication.publish(b"one")
    before = publication.path.stat().st_ino
    assert not publication.tend()
    assert publication.path.stat().st_ino == before


def cut(path: Path) -> None:
    os.truncate(path, 100)


def grow(path: Path) -> None:
    os.truncate(path, 8192)


def garble(path: Path) -> None:
    with path.open("r+b") as file:
        file.write(Random(1).randbytes(64))


def swap(path: Path) -> None:
    other = path.with_name("other")
    other.write_bytes(path.read_bytes())
    other.rename(path)


def mark(path: Path) -> None:
    with path.open("r+b") as file:
        file.seek(16)
        file.write(b"\1")


@pytest.mark.parametrize("harm", [cut, grow, garble, swap, mark, Path.unlink])
def test_damaged_ring_is_replaced_and_sequence_continues(
    publication: Publication, harm: Callable[[Path], None]
) -> None:
    publication.publish(b"one")
    publication.publish(b"two")
    harm(publication.path)
    assert publication.tend()
    assert not publication.tend()
    with RingReader(publication.path, after=2) as reader:
        assert publication.publish(b"three") == 3
        assert reader.next() == b"three"
        assert reader.lost == 0


@pytest.mark.parametrize("word", range(layout.STATIC_BYTES // 8))
def test_every_constant_header_word_is_checked(publication: Publication, word: int) -> None:
    publication.publish(b"one")
    with publication.path.open("r+b") as file:
        file.seek(8 * word)
        before = file.read(8)
        file.seek(8 * word)
        file.write(bytes([before[0] ^ 0x40]) + before[1:])
    assert publication.tend()
    assert not publication.tend()


@pytest.mark.parametrize("harm", [cut, grow, garble, swap, mark, Path.unlink])
def test_newest_frame_moves_to_file_once(publication: Publication, harm: Callable[[Path], None]) -> None:
    publication.publish(b"one")
    publication.publish(b"two")
    harm(publication.path)
    publication.tend()
    with RingReader(publication.path, after=0) as late, RingReader(publication.path, after=2) as early:
        assert (late.newest(), late.sequence) == (b"two", 2)
        assert early.next() is None


def test_frame_that_was_lent_is_not_written_again(publication: Publication) -> None:
    publication.publish(b"one")
    publication.loan(3)[:] = b"two"
    publication.publish_loan()
    publication.path.unlink()
    publication.tend()
    with RingReader(publication.path, after=2) as reader:
        assert reader.newest() is None
        assert publication.publish(b"three") == 3
        assert reader.next() == b"three"


@pytest.mark.parametrize("harm", [grow, swap, mark, Path.unlink])
def test_reader_of_old_file_reaches_new(publication: Publication, harm: Callable[[Path], None]) -> None:
    publication.publish(b"one")
    reader = RingReader(publication.path)
    harm(publication.path)
    publication.tend()
    publication.publish(b"two")
    assert reader.moved
    reader = reader.reopen()
    assert (reader.newest(), reader.next()) == (b"two", b"two")
    reader.close()
