"""A file in blocks: continued after an end, put in place whole, refused without room."""

import os
from pathlib import Path
from random import Random

import pytest

from swarmware.errors import InvalidInput, OutOfRange
from swarmware.footprint.blake2b import blake2b
from swarmware.transport.transfer.block_set import BLOCK_BYTES, block_count
from swarmware.transport.transfer.partial_file import PartialFile, digest_of, regular_file_size

CONTENT = Random(1).randbytes(3 * BLOCK_BYTES + 100)
DIGEST = blake2b(CONTENT, digest_size=32).digest()


def block(number: int) -> bytes:
    return CONTENT[number * BLOCK_BYTES : (number + 1) * BLOCK_BYTES]


def write(part: PartialFile, *numbers: int) -> None:
    for number in numbers:
        part.write(number * BLOCK_BYTES, block(number))


def test_blocks_in_any_order_become_file_at_once(tmp_path: Path) -> None:
    part = PartialFile(tmp_path, DIGEST, len(CONTENT))
    write(part, 3, 0, 0, 2)
    assert part.blocks.ranges() == ((1, 1),)
    target = tmp_path / "map.bin"
    assert not target.exists()
    write(part, 1)
    part.finish(target)
    part.close()
    assert target.read_bytes() == CONTENT
    assert digest_of(target) == DIGEST
    assert [path.name for path in tmp_path.iterdir()] == ["map.bin"]


def test_what_arrived_stays_after_an_end(tmp_path: Path) -> None:
    part = PartialFile(tmp_path, DIGEST, len(CONTENT))
    write(part, 1, 2)
    part.close()
    part = PartialFile(tmp_path, DIGEST, len(CONTENT))
    assert part.blocks.ranges() == ((0, 0), (3, 3))
    write(part, 0, 3)
    part.finish(tmp_path / "map.bin")
    part.close()
    assert (tmp_path / "map.bin").read_bytes() == CONTENT


def test_marks_without_their_blocks_count_for_nothing(tmp_path: Path) -> None:
    part = PartialFile(tmp_path, DIGEST, len(CONTENT))
    write(part, 0)
    part.close()
    (tmp_path / f".{DIGEST.hex()}.part").unlink()
    part = PartialFile(tmp_path, DIGEST, len(CONTENT))
    assert part.blocks.missing == 4
    part.close()


def test_another_content_is_refused_and_begins_again(tmp_path: Path) -> None:
    part = PartialFile(tmp_path, DIGEST, len(CONTENT))
    write(part, 0, 1, 2)
    part.write(3 * BLOCK_BYTES, bytes(100))
    (tmp_path / "map.bin").write_bytes(b"former")
    with pytest.raises(InvalidInput, match="digest"):
        part.finish(tmp_path / "map.bin")
    assert part.blocks.missing == 4
    assert (tmp_path / "map.bin").read_bytes() == b"former"
    part.close()
    assert PartialFile(tmp_path, DIGEST, len(CONTENT)).blocks.missing == 4


@pytest.mark.parametrize(
    ("offset", "size"),
    [
        (1, BLOCK_BYTES),
        (0, 5),
        (3 * BLOCK_BYTES, BLOCK_BYTES),
        (4 * BLOCK_BYTES, 0),
        (-BLOCK_BYTES, BLOCK_BYTES),
    ],
)
def test_bytes_that_are_no_block_are_refused(tmp_path: Path, offset: int, size: int) -> None:
    part = PartialFile(tmp_path, DIGEST, len(CONTENT))
    with pytest.raises(InvalidInput, match="expected a block"):
        part.write(offset, bytes(size))
    part.close()
    assert part.blocks.missing == 4


def test_full_disk_is_reported_before_first_block(tmp_path: Path) -> None:
    with pytest.raises(OutOfRange, match="are free"):
        PartialFile(tmp_path, DIGEST, 1 << 52)
    assert list(tmp_path.iterdir()) == []


def test_an_empty_file_is_complete_at_once(tmp_path: Path) -> None:
    part = PartialFile(tmp_path, blake2b(digest_size=32).digest(), 0)
    assert part.blocks.missing == block_count(0) == 0
    part.finish(tmp_path / "empty")
    part.close()
    assert (tmp_path / "empty").read_bytes() == b""


def test_endless_or_oversized_content_is_refused_unread(tmp_path: Path) -> None:
    fifo, folder, sparse = tmp_path / "fifo", tmp_path / "folder", tmp_path / "sparse"
    os.mkfifo(fifo)
    folder.mkdir()
    with sparse.open("wb") as file:
        file.truncate(40 << 30)
    for path in (fifo, folder, Path("/dev/zero")):
        with pytest.raises(InvalidInput, match=f"{path}: not a regular file"):
            regular_file_size(path, 100)
    with pytest.raises(OutOfRange, match=f"{sparse}: 42949672960 bytes; expected at most 100"):
        regular_file_size(sparse, 100)
    with sparse.open("wb") as file:
        file.truncate(100)
    assert regular_file_size(sparse, 100) == 100
