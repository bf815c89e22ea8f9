"""The ring: what a reader gets, what it counts, what a writer refuses."""

import errno
import mmap
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from swarmware.errors import Conflict, NotFound, OutOfRange, WireError
from swarmware.transport.shm import layout
from swarmware.transport.shm.layout import RingBusy, RingFull, ring_file
from swarmware.transport.shm.ring import RingReader, RingWriter

SMALL, LARGE = 256, layout.CHECKED_SLOT_BYTES + 1000
"""With and without a checksum in the slots."""


@pytest.fixture(params=[SMALL, LARGE], ids=["checked", "unchecked"])
def slot_bytes(request: pytest.FixtureRequest) -> int:
    size: int = request.param
    return size


@pytest.fixture
def writer(tmp_path: Path, slot_bytes: int) -> Iterator[RingWriter]:
    with RingWriter(tmp_path / "nav.pose.ring", slots=4, slot_bytes=slot_bytes) as writer:
        yield writer


@pytest.fixture
def reader(writer: RingWriter) -> Iterator[RingReader]:
    with RingReader(writer.path) as reader:
        yield reader


def words_of(path: Path) -> tuple[mmap.mmap, memoryview]:
    with path.open("r+b") as file:
        ring = mmap.mmap(file.fileno(), 0)
    return ring, memoryview(ring).cast("Q")


class Overtaken:
    """The mapped file as a slow reader sees it: half of its copy is from before the writer came round."""

    def __init__(self, ring: mmap.mmap, writer: RingWriter, frames: list[bytes]) -> None:
        self._ring = ring
        self._writer = writer
        self._frames = frames

    def __getitem__(self, where: slice) -> bytes:
        half = (where.start + where.stop) // 2
        before = self._ring[where.start : half]
        while self._frames:
            self._writer.write(self._frames.pop(0))
        return before + self._ring[half : where.stop]


def test_empty_ring_has_nothing_new_and_nothing_next(reader: RingReader) -> None:
    assert reader.sequence == reader.seen == 0
    assert reader.newest() is None
    assert reader.next() is None
    assert reader.view() is None
    assert reader.lost == 0


def test_the_newest_frame_is_what_was_written_last(writer: RingWriter, reader: RingReader) -> None:
    assert writer.write(b"one") == 1
    assert writer.write(memoryview(bytearray(b"two"))) == 2
    assert reader.sequence == 2 != reader.seen
    assert reader.newest() == b"two"
    assert reader.seen == 2
    assert writer.write(b"") == 3
    assert reader.newest() == b""


def test_frame_may_fill_slot_and_not_byte_more(writer: RingWriter, reader: RingReader) -> None:
    full = bytes(range(256)) * (writer.slot_bytes // 256 + 1)
    writer.write(full[: writer.slot_bytes])
    assert reader.newest() == full[: writer.slot_bytes]
    with pytest.raises(OutOfRange, match=f"{writer.slot_bytes + 1} bytes, expected 0 to {writer.slot_bytes}"):
        writer.write(full[: writer.slot_bytes + 1])
    assert reader.newest() == full[: writer.slot_bytes]


def test_next_gives_every_frame_once_and_in_order(writer: RingWriter, reader: RingReader) -> None:
    writer.write(b"1")
    writer.write(b"2")
    assert [reader.next(), reader.next(), reader.next()] == [b"1", b"2", None]
    writer.write(b"3")
    assert [reader.next(), reader.next()] == [b"3", None]
    assert reader.lost == 0


def test_overrun_is_counted_and_resumes_at_oldest(writer: RingWriter, reader: RingReader) -> None:
    for i in range(1, 11):
        writer.write(b"%d" % i)
    assert [reader.next(), reader.next(), reader.next(), reader.next()] == [b"8", b"9", b"10", None]
    assert reader.lost == 7


def test_full_ring_at_rest_is_read_entirely(writer: RingWriter, reader: RingReader) -> None:
    for i in range(1, 5):
        writer.write(b"%d" % i)
    assert [reader.next() for _ in range(4)] == [b"1", b"2", b"3", b"4"]
    assert reader.lost == 0


def test_oldest_frame_on_loan_is_counted_lost(writer: RingWriter, reader: RingReader) -> None:
    for i in range(1, 5):
        writer.write(b"%d" % i)
    writer.loan(3)
    assert [reader.next() for _ in range(4)] == [b"2", b"3", b"4", None]
    assert reader.lost == 1
    writer.publish()


def test_a_reader_starts_where_it_is_told_to(writer: RingWriter) -> None:
    for i in range(1, 11):
        writer.write(b"%d" % i)
    with RingReader(writer.path) as fresh, RingReader(writer.path, after=8) as here:
        assert fresh.next() is None
        assert here.next() == b"9"
    with RingReader(writer.path, after=0) as late, RingReader(writer.path, after=6) as just:
        assert (late.next(), late.lost) == (b"8", 7)
        assert (just.next(), just.lost) == (b"7", 0)


def test_torn_copy_is_thrown_away_and_made_again(writer: RingWriter, reader: RingReader) -> None:
    writer.write(b"a" * 100)
    later = [letter * 100 for letter in (b"b", b"c", b"d", b"e", b"f")]
    reader._map = Overtaken(reader._map, writer, later)  # type: ignore[assignment]  # stands in for the map
    assert reader.newest() == b"f" * 100
    assert reader.seen == 6
    reader._map = reader._map._ring  # type: ignore[attr-defined]  # the map again


def test_frame_overtaken_during_copy_is_counted_not_given(writer: RingWriter, reader: RingReader) -> None:
    writer.write(b"a" * 100)
    later = [letter * 100 for letter in (b"b", b"c", b"d", b"e", b"f")]
    reader._map = Overtaken(reader._map, writer, later)  # type: ignore[assignment]  # stands in for the map
    assert [reader.next(), reader.next()] == [b"d" * 100, b"e" * 100]
    assert reader.lost == 3
    reader._map = reader._map._ring  # type: ignore[attr-defined]  # the map again


def test_outside_damage_is_error_or_stream_loss(tmp_path: Path) -> None:
    with (
        RingWriter(tmp_path / "x.ring", slots=4, slot_bytes=SMALL) as writer,
        RingReader(writer.path) as reader,
    ):
        writer.write(b"first")
        writer.write(b"second")
        with writer.path.open("r+b") as file:
            found = file.read().index(b"second")
            file.seek(found)
            file.write(b"S")
        with pytest.raises(WireError, match="frame 2 is never complete"):
            reader.newest()
        assert [reader.next(), reader.next()] == [b"first", None]
        assert reader.lost == 1


def test_bytes_of_another_round_do_not_pass_checksum(tmp_path: Path) -> None:
    with (
        RingWriter(tmp_path / "x.ring", slots=4, slot_bytes=SMALL) as writer,
        RingReader(writer.path) as reader,
    ):
        writer.write(b"old")
        ring, words = words_of(writer.path)
        slot = (layout.HEADER_BYTES + writer._stride) // 8
        words[slot + layout.S_BEFORE] = words[slot + layout.S_AFTER] = words[layout.W_NEWEST] = 5
        with pytest.raises(WireError):
            reader.newest()
        words.release()
        ring.close()


def test_a_loan_is_seen_only_once_published(writer: RingWriter, reader: RingReader) -> None:
    writer.write(b"before")
    loan = writer.loan(10)
    loan[:] = b"0123456789"
    assert reader.newest() == b"before"
    assert writer.publish(4) == 2
    assert reader.newest() == b"0123"
    with pytest.raises(ValueError, match="released"):
        loan[0] = 1
    with pytest.raises(Conflict, match="nothing is on loan"):
        writer.publish()


def test_loan_is_exclusive_and_blocks_writes(writer: RingWriter, reader: RingReader) -> None:
    writer.loan(10)
    with pytest.raises(Conflict):
        writer.write(b"x")
    with pytest.raises(Conflict):
        writer.loan(1)
    with pytest.raises(OutOfRange, match="11 bytes published, expected 0 to 10"):
        writer.publish(11)
    writer.abandon()
    assert writer.write(b"x") == 1
    assert reader.newest() == b"x"
    with pytest.raises(OutOfRange):
        writer.loan(writer.slot_bytes + 1)


def test_view_is_valid_until_slot_rewritten(writer: RingWriter, reader: RingReader) -> None:
    writer.write(b"seen")
    view = reader.view()
    assert view is not None
    assert (bytes(view.data), view.sequence, reader.seen) == (b"seen", 1, 1)
    for _ in range(3):
        writer.write(b"more")
        assert view.still_valid()
    writer.loan(4)
    assert not view.still_valid()
    writer.publish()
    view.release()


def test_a_view_cannot_be_written(writer: RingWriter, reader: RingReader) -> None:
    writer.write(b"seen")
    with pytest.raises(TypeError, match="read-only"), reader.view() as view:  # type: ignore[union-attr]
        view.data[0] = 0


def test_views_in_order_count_what_they_skip(writer: RingWriter, reader: RingReader) -> None:
    for i in range(1, 8):
        writer.write(b"%d" % i)
    view = reader.next_view()
    assert view is not None
    assert bytes(view.data) == b"5"
    assert reader.lost == 4
    view.release()


def test_a_view_outlives_its_reader(writer: RingWriter) -> None:
    writer.write(b"kept")
    reader = RingReader(writer.path)
    view = reader.view()
    reader.close()
    assert view is not None
    assert bytes(view.data) == b"kept"
    view.release()


def test_second_writer_learns_the_first(writer: RingWriter) -> None:
    with pytest.raises(RingBusy, match=f"process {os.getpid()} writes this ring"):
        RingWriter(writer.path, slots=4, slot_bytes=writer.slot_bytes)


def test_ring_of_same_layout_continues_in_place(tmp_path: Path, slot_bytes: int) -> None:
    path = tmp_path / "a.ring"
    with RingWriter(path, slots=4, slot_bytes=slot_bytes) as first:
        first.write(b"1")
        nonce = first.nonce
        assert not first.taken_over
        reader = RingReader(path)
        assert reader.owner_alive()
    assert not reader.owner_alive()
    assert reader.newest() == b"1"
    with RingWriter(path, slots=4, slot_bytes=slot_bytes) as second:
        assert second.taken_over
        assert second.nonce == reader.nonce == nonce
        assert second.write(b"2") == 2
        assert reader.owner_alive()
        assert not reader.moved
        assert reader.next() == b"2"
        assert reader.lost == 0
    reader.close()


def test_ring_of_another_layout_continues_sequence(tmp_path: Path) -> None:
    path = tmp_path / "a.ring"
    with RingWriter(path, slots=4, slot_bytes=SMALL) as first:
        for i in range(1, 6):
            first.write(b"%d" % i)
        reader = RingReader(path, after=4)
    with RingWriter(path, slots=8, slot_bytes=SMALL) as second:
        assert not second.taken_over
        assert reader.moved
        assert reader.next() == b"5"
        reader = reader.reopen()
        assert reader.slots == 8
        assert reader.newest() is None
        assert reader.next() is None
        assert second.write(b"6") == 6
        assert reader.next() == reader.newest() == b"6"
        assert reader.lost == 0
    assert [path.name for path in tmp_path.iterdir()] == ["a.ring"]
    reader.close()


def test_unread_frames_of_replaced_file_are_lost(tmp_path: Path) -> None:
    path = tmp_path / "a.ring"
    with RingWriter(path, slots=4, slot_bytes=SMALL) as first:
        first.write(b"1")
        reader = RingReader(path)
        first.write(b"2")
        first.write(b"3")
    with RingWriter(path, slots=4, slot_bytes=SMALL + 64) as second:
        reader = reader.reopen()
        second.write(b"4")
        assert reader.next() == b"4"
        assert reader.lost == 2
    reader.close()


def test_recreated_ring_is_read_from_first_frame(tmp_path: Path) -> None:
    path = tmp_path / "a.ring"
    with RingWriter(path, slots=4, slot_bytes=SMALL) as first:
        for i in range(9):
            first.write(b"%d" % i)
        reader = RingReader(path)
        reader.newest()
        first.close(unlink=True)
    assert reader.moved
    with pytest.raises(NotFound):
        reader.reopen()
    assert reader.newest() == b"8"
    with RingWriter(path, slots=4, slot_bytes=SMALL) as second:
        second.write(b"fresh")
        reader = reader.reopen()
        assert reader.sequence != reader.seen
        assert reader.next() == b"fresh"
        assert reader.lost == 0
    reader.close()


def test_closing_with_unlink_leaves_foreign_file(tmp_path: Path) -> None:
    path = tmp_path / "a.ring"
    first = RingWriter(path, slots=4, slot_bytes=SMALL)
    path.unlink()
    with RingWriter(path, slots=4, slot_bytes=SMALL) as second:
        first.close(unlink=True)
        first.close(unlink=True)
        with RingReader(path) as reader:
            assert reader.nonce == second.nonce


def test_file_mode_is_group_read_owner_write(tmp_path: Path) -> None:
    old_mask = os.umask(0o077)
    try:
        with RingWriter(tmp_path / "a.ring", slots=4, slot_bytes=64) as writer:
            assert stat.S_IMODE(writer.path.stat().st_mode) == 0o640
        with RingWriter(tmp_path / "b.ring", slots=4, slot_bytes=64, mode=0o600) as writer:
            assert stat.S_IMODE(writer.path.stat().st_mode) == 0o600
    finally:
        os.umask(old_mask)


@pytest.mark.parametrize(
    ("slots", "slot_bytes", "expected"),
    [
        (3, 64, "3 slots, expected 4 to"),
        (1 << 17, 64, "slots, expected 4 to 65536"),
        (4, 0, "slots of 0 bytes, expected 1 to"),
        (4, (64 << 20) + 1, "expected 1 to 67108864"),
        (64, 64 << 20, "expected at most 1073741824"),
    ],
)
def test_a_ring_beyond_the_limits_is_refused(
    tmp_path: Path, slots: int, slot_bytes: int, expected: str
) -> None:
    with pytest.raises(OutOfRange, match=expected):
        RingWriter(tmp_path / "a.ring", slots=slots, slot_bytes=slot_bytes)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("number", "message"),
    [
        (errno.ENOSPC, r"shared memory is full: .*a\.ring, \d+ of \d+ bytes of its file system are used"),
        (errno.EFBIG, r"a\.ring: larger than files may be; expected a higher limit \(ulimit -f\)"),
    ],
)
def test_full_file_system_is_error_leaving_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, message: str
) -> None:
    def full(fd: int, offset: int, length: int) -> None:
        raise OSError(number, os.strerror(number))

    path = tmp_path / "a.ring"
    with monkeypatch.context() as patched:
        patched.setattr(os, "posix_fallocate", full)
        with pytest.raises(RingFull, match=message):
            RingWriter(path, slots=4, slot_bytes=64)
        assert list(tmp_path.iterdir()) == []
    RingWriter(path, slots=4, slot_bytes=64).close()


def test_a_missing_ring_is_not_found(tmp_path: Path) -> None:
    with pytest.raises(NotFound, match=r"no\.ring: no such file"):
        RingReader(tmp_path / "no.ring")


def test_folder_is_made_for_mirrors_of_platform(tmp_path: Path) -> None:
    path = ring_file(tmp_path, "nav/pose", "uav3")
    assert path == tmp_path / "uav3" / "nav.pose.ring"
    with RingWriter(path, slots=4, slot_bytes=64) as writer:
        assert writer.path.exists()


class Model(RuleBasedStateMachine):
    """A writer, a board reader and a stream reader beside a plain list of all frames."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = tempfile.TemporaryDirectory()
        self.path = Path(self.folder.name) / "a.ring"
        self.slots = 4
        self.writer = RingWriter(self.path, slots=self.slots, slot_bytes=64)
        self.stream = RingReader(self.path)
        self.frames: list[bytes] = []
        self.given: list[bytes] = []

    @rule(data=st.binary(max_size=64), times=st.integers(1, 9))
    def write(self, data: bytes, times: int) -> None:
        for _ in range(times):
            self.frames.append(data)
            assert self.writer.write(data) == len(self.frames)

    @rule(data=st.binary(min_size=1, max_size=64))
    def lend(self, data: bytes) -> None:
        self.writer.loan(64)[: len(data)] = data
        self.frames.append(data)
        assert self.writer.publish(len(data)) == len(self.frames)

    @rule(times=st.integers(1, 5))
    def read(self, times: int) -> None:
        for _ in range(times):
            data = self.stream.next()
            if data is None:
                assert self.stream.position == len(self.frames)
                return
            self.given.append(data)
            assert data == self.frames[self.stream.position - 1]

    @rule()
    def restart(self) -> None:
        self.writer.close()
        self.writer = RingWriter(self.path, slots=self.slots, slot_bytes=64)

    @rule()
    def resize(self) -> None:
        self.writer.close()
        self.slots = 12 - self.slots
        self.writer = RingWriter(self.path, slots=self.slots, slot_bytes=64)

    @invariant()
    def follows(self) -> None:
        if self.stream.moved:
            while (data := self.stream.next()) is not None:
                self.given.append(data)
            self.stream = self.stream.reopen()

    @invariant()
    def every_frame_is_given_or_counted(self) -> None:
        assert self.stream.position == len(self.given) + self.stream.lost
        assert self.stream.sequence == len(self.frames)

    @invariant()
    def newest_is_newest(self) -> None:
        data = self.stream.newest()
        assert data is None or data == self.frames[-1]

    def teardown(self) -> None:
        self.stream.close()
        self.writer.close()
        self.folder.cleanup()


TestModel = Model.TestCase


def test_the_readers_folder_stands_beside_its_ring() -> None:
    ring = ring_file(Path("/shm"), "nav/pose")
    assert layout.readers_folder(ring) == Path("/shm/nav.pose.readers")
