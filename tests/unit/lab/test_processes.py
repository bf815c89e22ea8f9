"""Processes: told apart, found again, ended."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmctl.session import processes
from swarmctl.session.processes import MARK, ProcessIdentity

Popen = subprocess.Popen[bytes]

WAIT = "import signal, sys; print('up', flush=True); signal.pause()"
STUBBORN = (
    "import signal; signal.signal(15, signal.SIG_IGN); print('up', flush=True)\nwhile True: signal.pause()"
)
FAMILY = (
    "import subprocess, sys; "
    "subprocess.Popen([sys.executable, '-c', sys.argv[1]], stdout=1, start_new_session=True); "
    "import signal; signal.pause()"
)


@pytest.fixture
def started() -> Iterator[list[Popen]]:
    made: list[Popen] = []
    yield made
    for process in made:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


def start(made: list[Popen], mark: str, *code: str) -> ProcessIdentity:
    process = subprocess.Popen(
        [sys.executable, "-c", *code], stdout=subprocess.PIPE, env={**os.environ, MARK: mark}
    )
    made.append(process)
    assert process.stdout is not None
    assert process.stdout.readline() == b"up\n"
    return processes.identity(process.pid)


def test_process_lives_until_ended_and_zombie_is_dead(started: list[Popen], tmp_path: Path) -> None:
    who = start(started, str(tmp_path), WAIT)
    assert who.alive()
    who.send(signal.SIGTERM)
    assert processes.wait_gone([who], 10) == []
    assert started[0].returncode is None, "not collected yet: a zombie"
    assert not who.alive()


def test_another_process_with_same_pid_is_not_it(started: list[Popen], tmp_path: Path) -> None:
    who = start(started, str(tmp_path), WAIT)
    later = ProcessIdentity(who.pid, who.start_ticks + 1)
    assert not later.alive()
    later.send(signal.SIGKILL)
    assert who.alive()


def test_a_pid_that_nobody_has_is_dead() -> None:
    assert not processes.identity(2**22).alive()
    assert not ProcessIdentity(0, 0).alive()


def test_all_lab_processes_are_found_and_ended(started: list[Popen], tmp_path: Path) -> None:
    parent = start(started, str(tmp_path), FAMILY, WAIT)
    other = start(started, str(tmp_path) + "x", WAIT)
    assert len(processes.marked(str(tmp_path))) == 2
    assert processes.end([parent], str(tmp_path)) == 0
    assert processes.marked(str(tmp_path)) == []
    assert other.alive(), "another lab's process is left alone"


def test_process_that_ignores_polite_signal_is_forced(started: list[Popen], tmp_path: Path) -> None:
    who = start(started, str(tmp_path), STUBBORN)
    assert processes.end([who], str(tmp_path), grace_s=0.1) == 1
    assert not who.alive()
