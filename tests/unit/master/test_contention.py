"""Contention for the role of the master: records, holders that cannot be watched, candidates that died."""

import asyncio
import fcntl
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.patience import until

from swarmware.node.master import role as role_module
from swarmware.node.master.record import Holder, RecordFile
from swarmware.node.master.role import LOCK_NAME, LeaderCandidate
from swarmware.runtime.pidfd import start_ticks

OTHER = """
import fcntl, sys
file = open(sys.argv[1], "r+b")
fcntl.flock(file, fcntl.LOCK_EX)
print(flush=True)
sys.stdin.read()
"""


@contextmanager
def other_process(lock: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A process that holds the lock of the role until its input ends."""
    with subprocess.Popen(
        [sys.executable, "-c", OTHER, str(lock)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        try:
            yield process
        finally:
            process.kill()


def candidate(folder: Path, log: list[str] | None = None) -> LeaderCandidate:
    notes: list[str] = [] if log is None else log
    return LeaderCandidate(
        folder,
        "ours",
        ring=lambda: notes.append("ring"),
        on_gained=lambda epoch: notes.append(f"gained {epoch}"),
        on_lost=lambda: notes.append("lost"),
    )


def record(folder: Path) -> RecordFile:
    return RecordFile(folder / LOCK_NAME)


@pytest.mark.parametrize("stated", ["right", "of another start", "of nobody"])
async def test_role_is_taken_over_at_holders_death(
    tmp_path: Path, stated: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(role_module, "RETRY_S", (0.005, 0.01))
    file = record(tmp_path)
    with other_process(tmp_path / LOCK_NAME) as process:
        start = start_ticks(process.pid)
        if stated != "of nobody":
            holder = Holder(7, process.pid, start if stated == "right" else start + 1, "other")
            file.write_holder(holder)
        role = candidate(tmp_path)
        role.start()
        await asyncio.sleep(0)
        assert not role.holding
        process.kill()
        await until(lambda: role.holding)
        assert role.holder.epoch == (1 if stated == "of nobody" else 8)
    role.close()
    file.close()


async def test_holder_in_another_namespace_is_retried_slower(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pauses: list[float] = []
    loop = asyncio.get_running_loop()
    call_later = loop.call_later

    def counted(delay: float, *rest: object) -> asyncio.TimerHandle:
        pauses.append(round(delay, 6))
        return call_later(0.0, *rest)  # type: ignore[arg-type]

    file = record(tmp_path)
    with (tmp_path / LOCK_NAME).open("r+b") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        file.write_holder(Holder(3, 2**22 + 5, 1, "of a container"))
        role = candidate(tmp_path)
        monkeypatch.setattr(loop, "call_later", counted)
        role.start()
        while len(pauses) < 8:  # noqa: ASYNC110 - each pause is one turn of the loop
            await asyncio.sleep(0)
        monkeypatch.undo()
        assert pauses[:7] == [0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.2]
        assert pauses[7] == 0.2
    role.close()
    file.close()


async def test_candidate_that_was_closed_takes_and_rings_nothing(tmp_path: Path) -> None:
    log: list[str] = []
    role = candidate(tmp_path, log)
    role.start()
    assert log == ["ring", "gained 1"]
    role.close()
    assert log[2:] == ["lost", "ring"]
    role.close()
    role.poll()
    assert log[4:] == []
    assert not role.holding


async def test_the_number_of_the_role_only_grows(tmp_path: Path) -> None:
    epochs = []
    for _ in range(4):
        role = candidate(tmp_path)
        role.start()
        epochs.append(role.holder.epoch)
        role.close()
    assert epochs == [1, 2, 3, 4]
    file = record(tmp_path)
    holder = file.holder()
    assert holder is not None
    assert (holder.epoch, holder.pid) == (4, 0), "given back"
    file.close()


async def test_volunteer_dying_early_blocks_no_one(tmp_path: Path) -> None:
    file = record(tmp_path)
    (tmp_path / "unrelated").touch()
    with other_process(tmp_path / "unrelated") as process:
        file.request_leadership(process.pid, start_ticks(process.pid))
        first = candidate(tmp_path)
        first.start()
        await asyncio.sleep(0)
        process.kill()
        process.wait()
        first.poll()
        await until(lambda: first.holding)
        assert first.holder.pid == os.getpid()
    first.close()
    file.close()


def remove(folder: Path) -> None:
    (folder / LOCK_NAME).unlink()


async def test_holder_keeps_role_without_its_file(
    tmp_path: Path,
) -> None:
    log: list[str] = []
    holder, other = candidate(tmp_path, log), candidate(tmp_path)
    holder.start()
    other.start()
    remove(tmp_path)
    assert other.tend() is None, "the holder makes the file again first"
    assert holder.tend() == tmp_path / LOCK_NAME
    assert other.tend() == tmp_path / LOCK_NAME
    assert (holder.holding, other.holding) == (True, False)
    assert other.holder == holder.holder
    assert "lost" not in log
    assert (holder.tend(), other.tend()) == (None, None)
    remove(tmp_path)
    holder.close()
    assert other.tend() == tmp_path / LOCK_NAME
    assert other.holding
    assert other.holder.epoch == 2, "the number goes on"
    other.close()
    assert other.tend() is None


async def test_of_two_holders_after_a_removal_one_stays(tmp_path: Path) -> None:
    former_log: list[str] = []
    former = candidate(tmp_path, former_log)
    former.start()
    remove(tmp_path)
    newcomer = candidate(tmp_path)
    newcomer.start()
    assert newcomer.holding, "a process that starts finds no file"
    former.tend()
    assert (former.holding, newcomer.holding) == (False, True)
    assert former_log[-2:] == ["lost", "ring"]
    newcomer.close()
    former.poll()
    await until(lambda: former.holding)
    assert former.holder.epoch == 2
    former.close()


async def test_preferred_holder_takes_role_back_from_newcomer(tmp_path: Path) -> None:
    former = candidate(tmp_path)
    former.start()
    former.volunteer("register#1")
    remove(tmp_path)
    newcomer = candidate(tmp_path)
    newcomer._me = (1, start_ticks(1))  # another process
    newcomer.start()
    former.tend()
    newcomer.poll()
    former.poll()
    assert (former.holding, newcomer.holding) == (True, False)
    assert former.holder.epoch == 2
    former.close()
    newcomer.close()
