"""Owner of a ring, and whether this same process still runs."""

import os
import subprocess
import sys

import msgspec
import pytest

from swarmware.runtime.pidfd import start_ticks
from swarmware.transport.shm import layout
from swarmware.transport.shm.owner import Owner


def test_this_process_is_alive() -> None:
    assert Owner.current().pid == os.getpid()
    assert Owner.current().alive()


@pytest.mark.parametrize(
    "change",
    [{"start_ticks": 1}, {"boot_id": 1}, {"pid": 0}, {"start_ticks": 0}, {"pid": 2**40}, {"pid": 2**64 - 1}],
)
def test_another_start_or_another_boot_is_another_process(change: dict[str, int]) -> None:
    assert not msgspec.structs.replace(Owner.current(), **change).alive()


def test_ended_process_is_dead_before_parent_checks() -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        assert child.stdin is not None
        owner = msgspec.structs.replace(Owner.current(), pid=child.pid, start_ticks=start_ticks(child.pid))
        assert owner.alive()
        child.kill()
        os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)  # dead, and still a zombie
        assert not owner.alive()
        child.wait()
    assert not owner.alive()


def test_owner_round_trips_through_header() -> None:
    words = memoryview(bytearray(layout.HEADER_BYTES)).cast("Q")
    assert not layout.read_owner(words).alive()
    layout.write_owner(words, Owner.current())
    assert layout.read_owner(words) == Owner.current()
