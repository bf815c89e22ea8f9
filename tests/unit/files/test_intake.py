"""Acceptance of offered files by a node."""

import pytest

from swarmd.files.config import Config
from swarmd.files.core.intake import PARTS_MAX, FileIntake
from swarmware.errors import Conflict, OutOfRange
from swarmware.types.file import FileOffer

S = 1_000_000_000


def offer(number: int = 1, size: int = 100, name: str = "map.png") -> FileOffer:
    return FileOffer(name, size, bytes([number]) * 32)


def test_an_offer_is_taken_continued_and_ended() -> None:
    intake = FileIntake(Config(limit_bytes=1000))
    assert intake.on_offer(offer(), 0, 0) == []
    assert intake.on_offer(offer(), 0, S) == []
    assert intake.on_block("map.png", offer().digest, S) == offer()
    assert intake.on_block("other.png", offer().digest, S) is None
    assert intake.on_block("map.png", offer(2).digest, S) is None
    assert intake.free_bytes(stored_bytes=300) == 600
    intake.on_ended(offer().digest)
    assert intake.on_block("map.png", offer().digest, S) is None
    assert intake.free_bytes(stored_bytes=300) == 700


def test_oversized_value_is_refused_with_limit() -> None:
    intake = FileIntake(Config(limit_bytes=1000, file_limit_bytes=500))
    with pytest.raises(OutOfRange, match="501 bytes; expected at most 500 \\(file_limit_bytes\\)"):
        intake.on_offer(offer(size=501), 0, 0)
    intake.on_offer(offer(1, 500), 0, 0)
    with pytest.raises(OutOfRange, match="300 of 1000"):
        intake.on_offer(offer(2, 301), 200, 0)
    intake.on_offer(offer(2, 300), 200, 0)


def test_incomplete_files_are_bounded_and_make_room() -> None:
    intake = FileIntake(Config(keep_parts_s=10))
    for number in range(PARTS_MAX):
        intake.on_offer(offer(number, name=f"f{number}"), 0, number * S // 10)
    with pytest.raises(Conflict, match="16 other files"):
        intake.on_offer(offer(99, name="late"), 0, 2 * S)
    gone = intake.on_offer(offer(99, name="late"), 0, 11 * S)
    assert gone == [bytes([number]) * 32 for number in range(10)]


def test_same_content_under_two_names_is_refused() -> None:
    intake = FileIntake(Config())
    intake.on_offer(offer(), 0, 0)
    with pytest.raises(Conflict, match="arrives as map"):
        intake.on_offer(offer(name="other.png"), 0, 0)
