"""Writers killed with SIGKILL at any moment, and stopped readers: nothing torn, stuck or left behind."""

import os
import random
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmware.errors import NotFound
from swarmware.model import paths
from swarmware.transport.shm.doorbell import Doorbell, DoorbellSenders
from swarmware.transport.shm.layout import RingBusy, readers_folder, ring_file
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.reap import reap
from swarmware.transport.shm.ring import RingReader, RingWriter

HERE = Path(__file__).parent
KILLS = 30
"""Per size of slot and manner of writing; five of them."""


class Writers:
    """Makes writers of one ring, one after the other, and kills them."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process
        self.pid = 0

    def start(self, path: Path, slot_bytes: int, manner: str) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{path} 4 {slot_bytes} {manner}\n")
        self._process.stdin.flush()
        self.pid = int(self._process.stdout.readline())

    def kill(self) -> None:
        assert self._process.stdout is not None
        os.kill(self.pid, signal.SIGKILL)
        self.pid = 0
        assert self._process.stdout.readline() == f"signal {-signal.SIGKILL}\n"


@pytest.fixture
def writers() -> Iterator[Writers]:
    with subprocess.Popen(
        [sys.executable, str(HERE / "tightloop.py")], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        writers = Writers(process)
        yield writers
        if writers.pid:
            writers.kill()
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(30) == 0


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """Rings and, in `bells`, doorbells of a node; empty again after a test, once reaped."""
    yield tmp_path
    reap(tmp_path, tmp_path)
    assert [path for path in tmp_path.rglob("*") if path.name != paths.doorbells(tmp_path).name] == []


def check(data: bytes, slot_bytes: int) -> int:
    """The number of a frame, which must be whole."""
    number = int.from_bytes(data[:4], "little")
    assert data == data[:4] * (slot_bytes // 4 - number % 5), f"torn: frame {number}"
    return number


@pytest.mark.parametrize(
    ("slot_bytes", "manner"),
    [(64, "write"), (4096, "write"), (65536, "write"), (200_000, "write"), (200_000, "loan")],
)
def test_writer_killed_in_loop_leaves_whole_frames(
    folder: Path, writers: Writers, slot_bytes: int, manner: str
) -> None:
    chance = random.Random(slot_bytes)
    path = ring_file(folder, "nav/pose")
    doorbells = DoorbellSenders(paths.doorbells(folder))
    with (
        Doorbell(paths.doorbells(folder)) as doorbell,
        ReaderNotifier(readers_folder(path), doorbells) as bells,
    ):
        bells.add(doorbell.name)
        writers.start(path, slot_bytes, manner)
        assert doorbell.wait(30)  # registered before there was a ring
        board, stream = RingReader(path), RingReader(path, after=0)
        given = 0
        for kill in range(KILLS):
            target = board.sequence + chance.randrange(1, 60)
            while board.sequence < target:
                assert doorbell.wait(30), "the writer is stuck"
                data = board.newest()
                assert data is not None
                assert check(data, slot_bytes) == board.seen
                view = board.view()
                assert view is not None
                copy = bytes(view.data)
                assert not view.still_valid() or check(copy, slot_bytes) == view.sequence
                view.release()
                while (data := stream.next()) is not None:
                    given += 1
                    assert check(data, slot_bytes) == stream.position
            writers.kill()
            assert not board.owner_alive()
            last = board.newest()
            assert last is not None
            assert check(last, slot_bytes) == board.seen == board.sequence
            doorbell.drain()
            if kill < KILLS - 1:
                writers.start(path, slot_bytes, manner)
                assert doorbell.wait(30)
            assert not board.moved
        while (data := stream.next()) is not None:
            given += 1
            assert check(data, slot_bytes) == stream.position
        assert given + stream.lost == stream.position == board.sequence
        board.close()
        stream.close()
    doorbells.close()


def test_stopped_reader_blocks_no_writer_and_counts_misses(folder: Path) -> None:
    path = ring_file(folder, "nav/pose")
    doorbells = DoorbellSenders(paths.doorbells(folder))
    command = [sys.executable, str(HERE / "slowreader.py"), str(path)]
    with (
        RingWriter(path, slots=16, slot_bytes=64) as writer,
        ReaderNotifier(readers_folder(path), doorbells) as bells,
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process,
    ):
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        os.kill(process.pid, signal.SIGSTOP)
        os.waitid(os.P_PID, process.pid, os.WSTOPPED)
        for number in range(1, 20_001):  # several times what the doorbell holds
            writer.write(b"%d" % number)
            bells.notify()
        os.kill(process.pid, signal.SIGCONT)
        writer.write(b"end")
        bells.notify()
        given, lost, newest = process.stdout.readline().split()
        assert newest == "end"
        assert int(given) + int(lost) == 20_001
        assert 0 < int(given) <= 17
    doorbells.close()


def test_doorbell_of_killed_reader_is_dropped_by_writer(folder: Path) -> None:
    path = ring_file(folder, "nav/pose")
    doorbells = DoorbellSenders(paths.doorbells(folder))
    command = [sys.executable, str(HERE / "slowreader.py"), str(path)]
    with RingWriter(path, slots=4, slot_bytes=64), ReaderNotifier(readers_folder(path), doorbells) as bells:
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            bells.notify()
            assert len(bells.names()) == 1
            process.kill()
        bells.notify()
        assert bells.names() == ()
        (left,) = (paths.doorbells(folder)).iterdir()
        assert reap(folder, folder).removed == (left,)
    doorbells.close()


def test_of_many_processes_exactly_one_writes(folder: Path) -> None:
    path = ring_file(folder, "nav/pose")
    code = (
        "import sys\n"
        "from pathlib import Path\n"
        "from swarmware.transport.shm.layout import RingBusy\n"
        "from swarmware.transport.shm.ring import RingWriter\n"
        "sys.stdin.readline()\n"
        "try:\n"
        "    writer = RingWriter(Path(sys.argv[1]), slots=4, slot_bytes=64)\n"
        "    print('mine', writer.write(b'x'), flush=True)\n"
        "except RingBusy:\n"
        "    print('busy', flush=True)\n"
        "sys.stdin.readline()\n"
    )
    for turn in range(1, 4):
        processes = [
            subprocess.Popen(
                [sys.executable, "-c", code, str(path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            for _ in range(4)
        ]
        for word in ("go\n", "end\n"):
            for process in processes:
                assert process.stdin is not None
                process.stdin.write(word)
                process.stdin.flush()
            if word == "go\n":
                answers = [process.stdout.readline() for process in processes if process.stdout is not None]
                assert sorted(answers) == ["busy\n", "busy\n", "busy\n", f"mine {turn}\n"]
        for process in processes:
            process.communicate(timeout=30)


def test_reaping_never_takes_what_a_living_process_uses(folder: Path) -> None:
    """A process makes rings and doorbells as fast as it can while this one reaps as fast as it can."""
    code = (
        "import sys\n"
        "from pathlib import Path\n"
        "from swarmware.transport.shm.doorbell import DoorbellSenders, Doorbell\n"
        "from swarmware.transport.shm.ring import RingReader, RingWriter\n"
        "folder = Path(sys.argv[1])\n"
        "for turn in range(400):\n"
        "    with RingWriter(folder / 'a.ring', slots=4 + turn % 3, slot_bytes=64) as writer:\n"
        "        with RingReader(folder / 'a.ring') as reader:\n"
        "            assert reader.nonce == writer.nonce, turn\n"
        "    with Doorbell(folder / 'bells') as bell:\n"
        "        doorbells = DoorbellSenders(folder / 'bells')\n"
        "        assert doorbells.ring(bell.name) and bell.drain(), turn\n"
        "        doorbells.close()\n"
    )
    removed = 0
    with subprocess.Popen([sys.executable, "-c", code, str(folder)]) as process:
        while process.poll() is None:
            removed += len(reap(folder, folder).removed)
    assert process.returncode == 0
    assert removed > 0


def test_second_process_learns_writer_and_succeeds_it(folder: Path, writers: Writers) -> None:
    path = ring_file(folder, "nav/pose")
    with Doorbell(paths.doorbells(folder)) as doorbell:
        doorbells = DoorbellSenders(paths.doorbells(folder))
        with ReaderNotifier(readers_folder(path), doorbells) as bells:
            bells.add(doorbell.name)
        writers.start(path, 64, "write")
        assert doorbell.wait(30)
        with RingReader(path) as reader:
            assert reader.owner.pid == writers.pid
            assert reader.owner_alive()
            with pytest.raises(RingBusy, match=f"process {writers.pid} writes this ring"):
                RingWriter(path, slots=4, slot_bytes=64)
            writers.kill()
            last = reader.sequence
            with RingWriter(path, slots=4, slot_bytes=64) as writer:
                assert writer.taken_over
                assert writer.write(b"mine") == last + 1
                writer.close(unlink=True)
        with pytest.raises(NotFound):
            RingReader(path)
        doorbells.close()
