"""The newest entries of a log are read from its newest segments."""

from pathlib import Path

import pytest

from swarmware.recorder import query as query_module
from swarmware.recorder.query import FolderSource, Query
from swarmware.recorder.ring import LogRing, segments
from swarmware.recorder.segment import LogChannel, SegmentReader
from swarmware.types import registry
from swarmware.types.scalar import Text

UTC = 1_700_000_000_000_000_000


def fill(directory: Path, platform: str, first: int) -> None:
    ring = LogRing(directory, segment_bytes=2000, min_free_bytes=0)
    note = LogChannel(platform, "mission/note", "event", "Text", f"{platform}:mission:out")
    for number in range(first, 400, 2):
        ring.append(note, number, UTC + number, registry.encode(Text(f"{number}")))
        ring.flush()
    ring.close()


def test_newest_entries_are_found_without_old_segments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[Path] = []

    class Reader(SegmentReader):
        def __init__(self, path: Path, offset: int = 0) -> None:
            read.append(path)
            super().__init__(path, offset)

    folders = [tmp_path / "uav1", tmp_path / "uav2"]
    for first, folder in enumerate(folders):
        fill(folder, folder.name, first)
    monkeypatch.setattr(query_module, "SegmentReader", Reader)
    source = FolderSource(folders)
    everything = [entry.utc_ns - UTC for entry in source.entries(Query())]
    assert everything == list(range(400))
    read.clear()
    newest = [entry.utc_ns - UTC for entry in source.entries(Query(limit=7, newest=True))]
    assert newest == everything[-7:]
    assert len(read) <= 4 < len(segments(folders[0]))
    beyond = [entry.utc_ns - UTC for entry in source.entries(Query(limit=1000, newest=True))]
    assert beyond == everything
    oldest = [entry.utc_ns - UTC for entry in source.entries(Query(limit=3))]
    assert oldest == [0, 1, 2]
