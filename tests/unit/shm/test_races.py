"""What another process does between two of our steps, played by the test at exactly that point."""

import fcntl
import os
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from swarmware.errors import Conflict
from swarmware.model import paths
from swarmware.transport.shm import doorbell, ringfile
from swarmware.transport.shm import reap as reaping
from swarmware.transport.shm.doorbell import Doorbell, DoorbellSenders
from swarmware.transport.shm.layout import RingBusy
from swarmware.transport.shm.lock import lock_within, try_lock
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.reap import reap
from swarmware.transport.shm.ring import RingReader, RingWriter


def once(before: Callable[[], object]) -> Callable[[int], bool]:
    """The lock, taken the first time only after somebody else has been busy."""
    pending = [before]

    def late(fd: int) -> bool:
        if pending:
            pending.pop()()
        return try_lock(fd)

    return late


def test_writer_locking_removed_file_takes_present_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.ring"
    RingWriter(path, slots=4, slot_bytes=64).close()

    def another_process() -> None:
        path.unlink()
        RingWriter(path, slots=4, slot_bytes=64).close()

    monkeypatch.setattr(ringfile, "try_lock", once(another_process))
    with RingWriter(path, slots=4, slot_bytes=64) as writer, RingReader(path) as reader:
        assert writer.nonce == reader.nonce
        writer.write(b"x")
        assert reader.newest() == b"x"


def test_writer_beaten_to_new_ring_learns_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.ring"
    faster: list[RingWriter] = []

    def another_process() -> None:
        # the first lock is on the unfinished file: remove the file, as its renaming would
        path.with_name("a.ring.new").unlink()
        faster.append(RingWriter(path, slots=4, slot_bytes=64))

    monkeypatch.setattr(ringfile, "try_lock", once(another_process))
    with pytest.raises(RingBusy, match=str(os.getpid())):
        RingWriter(path, slots=4, slot_bytes=64)
    with RingReader(path) as reader:
        assert reader.nonce == faster[0].nonce
    faster[0].close()
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.ring"]


def test_writer_waits_out_probe_of_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.ring"
    RingWriter(path, slots=4, slot_bytes=64).close()
    fd = os.open(path, os.O_RDONLY)
    fcntl.flock(fd, fcntl.LOCK_SH)

    def wait(locked_fd: int, timeout_s: float) -> bool:
        os.close(fd)  # the prober is done
        return lock_within(locked_fd, timeout_s)

    monkeypatch.setattr(ringfile, "lock_within", wait)
    with RingWriter(path, slots=4, slot_bytes=64) as writer:
        assert writer.taken_over


def test_lock_of_unknown_holder_is_finally_busy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.ring"
    RingWriter(path, slots=4, slot_bytes=64).close()
    fd = os.open(path, os.O_RDONLY)
    fcntl.flock(fd, fcntl.LOCK_EX)
    monkeypatch.setattr(ringfile, "LOCK_WAIT_S", 0.01)
    with RingReader(path) as reader:
        assert reader.owner_alive()  # a writer in another container looks like this
    with pytest.raises(RingBusy, match="cannot be seen from here"):
        RingWriter(path, slots=4, slot_bytes=64)
    os.close(fd)


def test_reaper_leaves_ring_made_after_it_looked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.ring"
    RingWriter(path, slots=4, slot_bytes=64).close()
    fresh: list[RingWriter] = []

    def another_process() -> None:
        path.unlink()
        fresh.append(RingWriter(path, slots=4, slot_bytes=64))

    monkeypatch.setattr(reaping, "try_lock", once(another_process))
    assert reap(tmp_path, tmp_path).removed == ()
    with RingReader(path) as reader:
        assert reader.nonce == fresh[0].nonce
        assert not reader.moved
    fresh[0].close()


def test_reader_entering_removed_folder_uses_present_one(tmp_path: Path) -> None:
    path = tmp_path / "a.readers"
    with Doorbell(tmp_path / "bells") as bell:
        doorbells = DoorbellSenders(tmp_path / "bells")
        with ReaderNotifier(path, doorbells) as writer, ReaderNotifier(path, doorbells) as reader:
            writer.notify()
            assert reader.names() == ()  # it has the folder open
            path.rmdir()
            reader.add(bell.name)
            writer.notify()
            assert bell.drain()
        doorbells.close()


def test_reaper_and_new_doorbell_do_not_collide(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = paths.doorbells(tmp_path)
    folder.mkdir()
    monkeypatch.setattr(doorbell, "FOLDER_WAIT_S", 0.01)
    with doorbell.folder_lock(folder):
        with pytest.raises(Conflict, match="locked for more than"):
            Doorbell(folder)
        os.mkfifo(folder / "17-0")  # made, and not yet opened, by the holder of the lock
        assert reap(tmp_path, tmp_path).removed == ()
    assert reap(tmp_path, tmp_path).removed == (folder / "17-0",)


def test_writer_waits_for_reaper_and_reserves_ring(tmp_path: Path) -> None:
    path = tmp_path / "a.ring"
    with path.with_name("a.ring.new").open("w") as unfinished:
        fcntl.flock(unfinished, fcntl.LOCK_EX)
        end = threading.Timer(0.02, unfinished.close)
        end.start()
        with RingWriter(path, slots=4, slot_bytes=64) as writer:
            assert writer.write(b"first") == 1
        end.join()
