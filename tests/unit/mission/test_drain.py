"""The record of a drain on the disk."""

from pathlib import Path

import pytest

from swarmd.mission.drain import UNKNOWN, Drain
from swarmware.errors import SwarmError


def test_drain_is_kept_for_next_daemon(tmp_path: Path) -> None:
    file = tmp_path / "drained.json"
    first = Drain(file)
    assert first.by == ""
    first.begin("ann@gcs", 1)
    assert (first.by, Drain(file).by) == ("ann@gcs", "ann@gcs")
    first.end()
    first.end()
    assert (first.by, Drain(file).by) == ("", "")


@pytest.mark.parametrize(
    "content", [b"", b"{", b'{"by": 3, "utc_ns": 1}', b'{"by": "", "utc_ns": 1}', b"\xff"]
)
def test_record_that_cannot_be_read_counts_as_drain(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "drained.json"
    file.write_bytes(content)
    damaged = Drain(file)
    assert damaged.by == UNKNOWN
    damaged.end()
    assert not file.exists()


def test_unrecordable_drain_is_refused(tmp_path: Path) -> None:
    (tmp_path / "data").write_text("a file where a folder is expected")
    drain = Drain(tmp_path / "drained.json")
    unwritable = Drain(tmp_path / "drained.json")
    unwritable._file = tmp_path / "data" / "drained.json"
    with pytest.raises(SwarmError, match="not written, so not drained"):
        unwritable.begin("ann", 1)
    assert (unwritable.by, drain.by) == ("", "")
