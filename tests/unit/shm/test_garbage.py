"""Files that others made: whatever their bytes, the answer is an error of ours or a value."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from swarmware.errors import Denied, SwarmError, WireError
from swarmware.transport.shm import layout
from swarmware.transport.shm.doorbell import DoorbellSenders
from swarmware.transport.shm.layout import Geometry
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.ring import RingReader, RingWriter


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("shm")


def header(words: dict[int, int], size: int) -> bytes:
    data = memoryview(bytearray(layout.HEADER_BYTES)).cast("Q")
    for position, value in words.items():
        data[position] = value
    data[layout.W_STATIC_CRC] = layout.static_crc(data)
    return bytes(data).ljust(size, b"\0")


def read_everything(path: Path) -> None:
    with RingReader(path, after=0) as reader:
        for call in (
            reader.newest,
            reader.view,
            reader.next,
            reader.next_view,
            reader.owner_alive,
        ):
            try:
                call()
            except WireError:
                continue


@given(st.binary(max_size=3 * layout.HEADER_BYTES))
@example(b"")
@example(b"SWARMRNG")
@example(b"SWARMRNG" + bytes(1000))
def test_any_bytes_are_refused_as_a_ring(folder: Path, data: bytes) -> None:
    path = folder / "a.ring"
    path.write_bytes(data)
    with pytest.raises(WireError, match=r"a\.ring"):
        RingReader(path)


U64 = st.one_of(st.integers(0, 20), st.integers(0, (1 << 64) - 1))


@given(st.lists(st.tuples(st.integers(0, 31), U64), max_size=4), st.integers(0, 4096))
def test_header_of_any_words_is_refused_or_read(
    folder: Path, changes: list[tuple[int, int]], size: int
) -> None:
    geometry = Geometry(4, 64)
    words = {
        layout.W_MAGIC: layout.MAGIC,
        layout.W_VERSION: layout.VERSION,
        layout.W_SLOTS: geometry.slots,
        layout.W_SLOT_BYTES: geometry.slot_bytes,
    }
    path = folder / "b.ring"
    path.write_bytes(header(words | dict(changes), geometry.file_bytes if size % 2 else size))
    try:
        read_everything(path)
    except WireError:
        return


@given(st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 255)), min_size=1, max_size=30))
def test_damaged_ring_is_refused_or_healed(folder: Path, changes: list[tuple[int, int]]) -> None:
    path = folder / "c.ring"
    path.unlink(missing_ok=True)
    with RingWriter(path, slots=4, slot_bytes=64) as writer:
        for i in range(6):
            writer.write(b"%d" % i)
    data = bytearray(path.read_bytes())
    for position, value in changes:
        data[position % len(data)] = value
    path.write_bytes(data)
    with contextlib.suppress(WireError):
        read_everything(path)
    with RingWriter(path, slots=4, slot_bytes=64) as writer, RingReader(path) as reader:
        writer.write(b"healed")
        assert reader.newest() == reader.next() == b"healed"
    assert sorted(entry.name for entry in folder.iterdir() if entry.name.startswith("c.")) == ["c.ring"]


@given(st.lists(st.text(st.characters(codec="utf-8", exclude_characters="/\0"), min_size=1, max_size=60)))
@example([".ring", "..readers", "17-0", "x" * 60, "17-0.ring", " "])
def test_any_names_among_readers_are_skipped_or_rung(
    tmp_path_factory: pytest.TempPathFactory, names: list[str]
) -> None:
    path = tmp_path_factory.mktemp("d") / "d.readers"
    path.mkdir()
    for name in names:
        with contextlib.suppress(OSError):
            (path / name).touch()
    doorbells = DoorbellSenders(path.parent)
    with ReaderNotifier(path, doorbells) as notifier:
        notifier.add("17-0")
        assert "17-0" in notifier.names()
        notifier.notify()
        assert notifier.names() == ()
    doorbells.close()


def test_name_that_leads_out_of_folder_is_refused(tmp_path: Path) -> None:
    notifier = ReaderNotifier(tmp_path / "a.readers", DoorbellSenders(tmp_path))
    with pytest.raises(WireError, match="cannot name a doorbell"):
        notifier.add("../victim")


@pytest.mark.parametrize("kind", ["folder", "fifo", "link", "dangling"])
def test_non_file_is_refused_then_removed_by_writer(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a.ring"
    if kind == "folder":
        path.mkdir()
    elif kind == "fifo":
        os.mkfifo(path)
    else:
        target = tmp_path / "target"
        if kind == "link":
            target.write_bytes(b"untouched")
        path.symlink_to(target)
    with pytest.raises(WireError):
        RingReader(tmp_path / "a.ring")
    with RingWriter(path, slots=4, slot_bytes=64) as writer:
        writer.write(b"value")
        reader = RingReader(path, after=0)
        assert reader.next() == b"value"
        reader.close()
    assert kind != "link" or (tmp_path / "target").read_bytes() == b"untouched"


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "shm").write_bytes(b"")
    with pytest.raises(SwarmError):
        RingReader(tmp_path / "shm" / "a.ring")
    with pytest.raises(SwarmError):
        RingWriter(tmp_path / "shm" / "a.ring", slots=4, slot_bytes=64)
    with pytest.raises(SwarmError):
        ReaderNotifier(tmp_path / "shm" / "a.readers", DoorbellSenders(tmp_path)).add("1-0")


def test_ring_of_another_version_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.ring"
    path.write_bytes(header({layout.W_MAGIC: layout.MAGIC, layout.W_VERSION: 9}, 1024))
    with pytest.raises(WireError, match="ring layout 9, expected 1"):
        RingReader(path)


@pytest.fixture
def ordinary_user() -> Iterator[None]:
    """Drops to the user nobody for a while, because root may open everything."""
    before = os.geteuid()
    if before == 0:
        os.seteuid(65534)
    yield
    os.seteuid(before)


@pytest.fixture
def forbidden(tmp_path: Path) -> Path:
    path = tmp_path / "a.ring"
    RingWriter(path, slots=4, slot_bytes=64, mode=0o000).close()
    return path


def test_no_permission_is_denied(forbidden: Path, ordinary_user: None) -> None:
    path = forbidden
    with pytest.raises(Denied, match="no permission"):
        RingReader(path)
    with pytest.raises(Denied, match="no permission"):
        RingWriter(path, slots=4, slot_bytes=64)
