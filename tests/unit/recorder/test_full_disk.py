"""A disk without room at any call: every entry is there once, and nothing half-written is taken for one."""

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swarmware.recorder.query import FolderSource, Query
from swarmware.recorder.ring import LogRing, Repairs
from swarmware.recorder.segment import LogChannel
from swarmware.types import registry
from swarmware.types.scalar import Text

NOTE = LogChannel("uav1", "mission/note", "event", "Text", "uav1:mission:out")
UTC = 1_700_000_000_000_000_000
CALLS = ("open", "pwrite", "fdatasync", "close")
"""Everything that the writer of segments asks of the disk."""


class NoRoom:
    """Lets one call of the disk fail while it is full; a write takes a part before that."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, call: str) -> None:
        self.full = False
        self.failed = 0
        self._real: Callable[..., Any] = getattr(os, call)
        self._call = call
        monkeypatch.setattr(os, call, self._do)

    def _do(self, *args: Any, **more: Any) -> Any:
        if not self.full or (self._call == "open" and not str(args[0]).endswith(".mcap")):
            return self._real(*args, **more)
        self.failed += 1
        match self._call:
            case "pwrite":
                self._real(args[0], args[1][:7], args[2])
            case "close":
                self._real(*args)
        raise OSError(errno.ENOSPC, "No space left on device")


def append(ring: LogRing, number: int) -> None:
    ring.append(NOTE, number, UTC + number, registry.encode(Text(f"{number}")))


@pytest.mark.parametrize("call", CALLS)
def test_every_entry_exists_once_after_space_returns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    ring = LogRing(tmp_path, segment_bytes=1500, min_free_bytes=0, sync="batch")
    disk = NoRoom(monkeypatch, call)
    written = refused = 0
    for batch in range(40):
        disk.full = batch % 8 in (2, 3, 4)
        for _ in range(10):
            written += 1
            append(ring, written)
        try:
            ring.flush()
        except OSError as error:
            assert error.errno == errno.ENOSPC
            refused += 1
    disk.full = False
    ring.close()
    assert disk.failed and refused, "the disk was asked while it was full, and it was said"
    source = FolderSource([tmp_path])
    assert [entry.sequence for entry in source.entries(Query())] == list(range(1, written + 1))
    assert source.losses() == []


@pytest.mark.parametrize("call", ["open", "rename", "write"])
def test_start_without_space_is_retried_remembering_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    ring = LogRing(tmp_path)
    for number in range(1, 61):
        append(ring, number)
    ring.flush()
    path = next(tmp_path.glob("*.mcap"))
    data = bytearray(path.read_bytes())
    ring.close()
    at = data.index(registry.encode(Text("31")))
    data[at - 30 : at + 3] = bytes(33)
    path.write_bytes(data)
    (tmp_path / "00000000.mcap").write_bytes(b"\xff" * 5000)

    repairs = Repairs()
    with monkeypatch.context() as patch:
        if call == "open":
            NoRoom(patch, "open").full = True
        else:
            patch.setattr(Path, "rename" if call == "rename" else "open", no_room)
        with pytest.raises(OSError, match="No space"):
            LogRing(tmp_path, repairs=repairs)
    again = LogRing(tmp_path, repairs=repairs)
    append(again, 61)
    again.close()
    assert [(hole.first, hole.last) for hole in again.repairs.holes] == [(31, 31)]
    assert [aside.name for aside in again.repairs.set_aside] == ["00000000.damaged"]
    numbers = [entry.sequence for entry in FolderSource([tmp_path]).entries(Query())]
    assert numbers == [number for number in range(1, 62) if number != 31]


def no_room(*_: Any, **__: Any) -> Any:
    raise OSError(errno.ENOSPC, "No space left on device")
