"""Kills a process at every step of one operation on shared memory and checks what it leaves.

`everystep.py OPERATION FOLDER`: for step 1, 2, 3 … a fresh folder is prepared, a child does the operation and
kills itself with SIGKILL at that step, and the parent checks that readers saw nothing torn and that a restart
heals the rest. It ends with the first child that lives to the end, and prints the number of steps.

A step is a bytecode instruction of the library that can change something outside the interpreter: a call or a
store into mapped memory. A kill at any other instruction leaves what a kill at the next step leaves.
"""

import dis
import functools
import os
import shutil
import signal
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FrameType

from swarmware.errors import NotFound
from swarmware.model import paths
from swarmware.transport.shm.doorbell import Doorbell, DoorbellSenders
from swarmware.transport.shm.layout import CHECKED_SLOT_BYTES, readers_folder, ring_file
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.reap import reap, remove_all
from swarmware.transport.shm.ring import RingReader, RingWriter

LIBRARY = str(Path(sys.modules[RingWriter.__module__].__file__ or "").parent)
SMALL, LARGE = 64, CHECKED_SLOT_BYTES + 64
OLD, NEW = b"old", b"new"


class Case:
    """One operation: how it is prepared, done and checked. Each case gets an empty folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.path = ring_file(folder, "nav/pose")
        self.doorbells = DoorbellSenders(paths.doorbells(folder))

    def prepare(self) -> None:
        """In the parent, before the fork."""

    def do(self) -> Callable[[], object]:
        """In the child: prepares what must not be killed and returns the operation."""
        raise NotImplementedError

    def check(self, *, killed: bool) -> None:
        """In the parent, after the death of the child."""
        raise NotImplementedError

    def check_empty(self) -> None:
        """After a restart and reaping nothing may be left."""
        self.doorbells.close()
        reap(self.folder, self.folder)
        left = [path for path in self.folder.rglob("*") if not path.is_dir()]
        assert left == [], left


class RingCase(Case):
    """A ring that holds OLD; the child becomes its next writer and adds NEW."""

    slot_bytes = SMALL
    slots_after = 4

    def prepare(self) -> None:
        with RingWriter(self.path, slots=4, slot_bytes=self.slot_bytes) as writer:
            for _ in range(5):
                writer.write(OLD)
        self.board = RingReader(self.path)
        self.stream = RingReader(self.path)

    def check(self, *, killed: bool) -> None:
        assert not self.board.owner_alive()
        assert self.board.newest() in {OLD, NEW}
        with RingWriter(self.path, slots=self.slots_after, slot_bytes=self.slot_bytes) as writer:
            assert writer.sequence in {5, 6}
            before = writer.sequence
            assert writer.write(b"healed") == before + 1
            frames = self.read_on()
            assert frames in ([NEW, b"healed"], [b"healed"]), frames
            assert self.stream.position == before + 1
            assert self.stream.lost == before - 5 + 1 - len(frames)
            self.board.close()
            with RingReader(self.path) as reader:
                assert reader.newest() == b"healed"
                assert reader.owner_alive()
        self.stream.close()
        self.check_empty()

    def read_on(self) -> list[bytes]:
        frames = []
        for _ in range(2):
            while (data := self.stream.next()) is not None:
                frames.append(data)
            if self.stream.moved:
                self.stream = self.stream.reopen()
        return frames


class Write(RingCase):
    def do(self) -> Callable[[], object]:
        writer = RingWriter(self.path, slots=4, slot_bytes=self.slot_bytes)
        return lambda: writer.write(NEW)


class WriteLarge(Write):
    slot_bytes = LARGE


class Loan(RingCase):
    def do(self) -> Callable[[], object]:
        writer = RingWriter(self.path, slots=4, slot_bytes=self.slot_bytes)

        def lend() -> None:
            writer.loan(len(NEW))[:] = NEW
            writer.publish()

        return lend


class LoanLarge(Loan):
    slot_bytes = LARGE


class TakeOver(RingCase):
    def do(self) -> Callable[[], object]:
        return lambda: RingWriter(self.path, slots=4, slot_bytes=self.slot_bytes)


class Replace(RingCase):
    """The child writes another layout; the restart has that too."""

    slots_after = 8

    def do(self) -> Callable[[], object]:
        return lambda: RingWriter(self.path, slots=8, slot_bytes=self.slot_bytes).write(NEW)


class ReplaceAndBack(Replace):
    """The restart has the old layout again."""

    slots_after = 4


class Make(Case):
    """The child makes a ring where there was none."""

    def do(self) -> Callable[[], object]:
        return lambda: RingWriter(self.path, slots=4, slot_bytes=SMALL).write(NEW)

    def check(self, *, killed: bool) -> None:
        try:
            with RingReader(self.path) as reader:
                assert reader.newest() in {None, NEW}
                assert not reader.owner_alive()
        except NotFound:
            assert killed
        with RingWriter(self.path, slots=4, slot_bytes=SMALL) as writer, RingReader(self.path) as reader:
            assert writer.write(b"healed") in {1, 2}
            assert reader.newest() == b"healed"
        self.check_empty()


class MakeAndReap(Make):
    """The process is not restarted, so the reaper alone cleans up."""

    def check(self, *, killed: bool) -> None:
        self.check_empty()


class Unlink(RingCase):
    """The child ends in order and removes its ring; a reader must find the next one."""

    def do(self) -> Callable[[], object]:
        writer = RingWriter(self.path, slots=4, slot_bytes=SMALL)
        return lambda: writer.close(unlink=True)

    def check(self, *, killed: bool) -> None:
        assert self.board.newest() == OLD
        with RingWriter(self.path, slots=4, slot_bytes=SMALL) as writer:
            assert writer.write(b"healed") in {1, 6}
            assert self.board.nonce == writer.nonce or self.board.moved
            assert self.read_on() == [b"healed"]
        self.board.close()
        self.stream.close()
        self.check_empty()


class Add(Case):
    """The child registers at a ring that is not there yet."""

    def do(self) -> Callable[[], object]:
        doorbell = Doorbell(paths.doorbells(self.folder))
        bells = ReaderNotifier(readers_folder(self.path), self.doorbells)
        return lambda: bells.add(doorbell.name)

    def check(self, *, killed: bool) -> None:
        with (
            Doorbell(paths.doorbells(self.folder)) as doorbell,
            ReaderNotifier(readers_folder(self.path), self.doorbells) as writer,
            ReaderNotifier(readers_folder(self.path), self.doorbells) as reader,
        ):
            writer.notify()
            reader.add(doorbell.name)
            writer.notify()
            assert doorbell.drain()
            assert writer.names() == (doorbell.name,)
            reader.remove(doorbell.name)
        self.check_empty()


class AddAtWriter(Add):
    """The writer has the table open already and must notice the next reader all the same."""

    def prepare(self) -> None:
        self.doorbell = Doorbell(paths.doorbells(self.folder))
        self.writer = ReaderNotifier(readers_folder(self.path), self.doorbells)
        self.writer.add(self.doorbell.name)
        self.writer.notify()

    def check(self, *, killed: bool) -> None:
        assert self.doorbell.drain()
        self.writer.notify()
        assert self.doorbell.drain()
        self.doorbell.close()
        super().check(killed=killed)
        self.writer.close()


class Remove(AddAtWriter):
    def do(self) -> Callable[[], object]:
        doorbell = Doorbell(paths.doorbells(self.folder))
        bells = ReaderNotifier(readers_folder(self.path), self.doorbells)
        bells.add(doorbell.name)
        return lambda: bells.remove(doorbell.name)


class RingDead(AddAtWriter):
    """The child is a writer that drops a reader which is gone."""

    def do(self) -> Callable[[], object]:
        bells = ReaderNotifier(readers_folder(self.path), self.doorbells)
        bells.add("17-0")
        return bells.notify


class MakeDoorbell(Case):
    def do(self) -> Callable[[], object]:
        return lambda: Doorbell(paths.doorbells(self.folder))

    def check(self, *, killed: bool) -> None:
        with Doorbell(paths.doorbells(self.folder)) as doorbell:
            assert self.doorbells.ring(doorbell.name)
            assert doorbell.drain()
        self.check_empty()


class CloseDoorbell(MakeDoorbell):
    def do(self) -> Callable[[], object]:
        return Doorbell(paths.doorbells(self.folder)).close


class Reap(RingCase):
    """The child is a reaper; the node starts again over what it left."""

    def prepare(self) -> None:
        super().prepare()
        RingWriter(ring_file(self.folder, "nav/pose", "uav1"), slots=4, slot_bytes=SMALL).close()
        self.path.with_name("x.ring.new").write_bytes(bytes(100))
        self.table = readers_folder(self.path)
        self.writer = ReaderNotifier(self.table, self.doorbells)
        self.writer.add("17-0")
        (paths.doorbells(self.folder)).mkdir(exist_ok=True)
        os.mkfifo(paths.doorbells(self.folder) / "17-0")

    def do(self) -> Callable[[], object]:
        return lambda: reap(self.folder, self.folder)

    def check(self, *, killed: bool) -> None:
        self.writer.notify()
        with (
            Doorbell(paths.doorbells(self.folder)) as doorbell,
            ReaderNotifier(self.table, self.doorbells) as reader,
            RingWriter(self.path, slots=4, slot_bytes=SMALL) as writer,
        ):
            reader.add(doorbell.name)
            assert writer.write(b"healed") in {1, 6}
            self.writer.notify()
            assert doorbell.drain()
            assert self.read_on() == [b"healed"]
            reader.remove(doorbell.name)
        self.writer.close()
        self.board.close()
        self.stream.close()
        self.check_empty()


class RemoveAll(Reap):
    def do(self) -> Callable[[], object]:
        return lambda: remove_all(self.folder, self.folder)


CASES: dict[str, type[Case]] = {
    "write": Write,
    "write-large": WriteLarge,
    "loan": Loan,
    "loan-large": LoanLarge,
    "take-over": TakeOver,
    "replace": Replace,
    "replace-and-back": ReplaceAndBack,
    "make": Make,
    "make-and-reap": MakeAndReap,
    "unlink": Unlink,
    "add": Add,
    "add-at-writer": AddAtWriter,
    "remove": Remove,
    "ring-dead": RingDead,
    "make-doorbell": MakeDoorbell,
    "close-doorbell": CloseDoorbell,
    "reap": Reap,
    "remove-all": RemoveAll,
}


@functools.cache
def steps(code: CodeType) -> frozenset[int]:
    """Where in the code something outside may change."""
    return frozenset(
        instruction.offset
        for instruction in dis.get_instructions(code)
        if instruction.opname.startswith(("CALL", "STORE_SUBSCR", "STORE_SLICE", "BEFORE_WITH", "RETURN"))
    )


def die_at(step: int) -> None:
    """Have this process killed before the given step from here on.

    An instruction counts at its first two executions: a search through 64 free entries is one state, not 64.
    """
    count = 0
    visits: Counter[tuple[CodeType, int]] = Counter()

    def trace(frame: FrameType, event: str, arg: object) -> object:
        nonlocal count
        if not frame.f_code.co_filename.startswith(LIBRARY):
            return None
        frame.f_trace_opcodes = True
        frame.f_trace_lines = False
        if event == "opcode" and frame.f_lasti in steps(frame.f_code):
            here = frame.f_code, frame.f_lasti
            visits[here] += 1
            count += visits[here] <= 2
            if count == step:
                os.kill(os.getpid(), signal.SIGKILL)
        return trace

    sys.settrace(trace)  # type: ignore[arg-type]  # the stub wants a narrower return type


def run(case: type[Case], folder: Path, step: int) -> bool:
    """One kill; False when the operation has no such step."""
    folder.mkdir()
    subject = case(folder)
    subject.prepare()
    pid = os.fork()
    if pid == 0:
        operation = subject.do()
        die_at(step)
        operation()
        os._exit(0)
    _, status = os.waitpid(pid, 0)
    code = os.waitstatus_to_exitcode(status)
    assert code in {0, -signal.SIGKILL}, code
    subject.check(killed=code != 0)
    shutil.rmtree(folder, ignore_errors=True)
    return code != 0


def main() -> None:
    operation, folder = sys.argv[1], Path(sys.argv[2])
    step = 1
    try:
        while run(CASES[operation], folder / str(step), step):
            step += 1
    except BaseException:
        print(f"{operation}: killed at step {step}", file=sys.stderr)
        raise
    print(step - 1)


if __name__ == "__main__":
    main()
