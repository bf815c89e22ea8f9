"""The start of a node: a number that only grows, shared by all that live on it; and its end by a signal."""

import asyncio
import os
import signal
import time
from pathlib import Path

import pytest

from swarmware.model.clock import utc_ns
from swarmware.module.module import Module
from swarmware.node.incarnation import NodeIncarnation
from swarmware.testing.tmpnode import make_node


def test_joiner_keeps_number_and_next_start_raises(
    tmp_path: Path,
) -> None:
    run, shm = tmp_path / "run", tmp_path / "shm"
    before_ns = utc_ns()
    first = NodeIncarnation(run, shm)
    second = NodeIncarnation(run, shm)
    assert second.boot_id == first.boot_id >= before_ns
    first.leave()
    assert shm.exists(), "the other one still lives here"
    second.leave()
    second.leave()
    assert not shm.exists()
    third = NodeIncarnation(run, shm)
    assert third.boot_id > second.boot_id
    assert shm.is_dir()
    third.leave()


def test_number_grows_although_wall_clock_was_set_back(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir(mode=0o700)
    ahead = utc_ns() + 10**18
    (run / "boot").write_text(str(ahead))
    boot = NodeIncarnation(run, tmp_path / "shm")
    assert boot.boot_id == ahead + 1
    boot.leave()


def test_start_of_node_is_on_monotonic_clock(tmp_path: Path) -> None:
    run, shm = tmp_path / "run", tmp_path / "shm"
    before_ns = time.monotonic_ns()
    first = NodeIncarnation(run, shm)
    second = NodeIncarnation(run, shm)
    assert before_ns <= first.started_mono_ns == second.started_mono_ns <= time.monotonic_ns()
    assert first.boot_id == second.boot_id
    first.leave()
    second.leave()
    third = NodeIncarnation(run, shm)
    assert third.started_mono_ns > first.started_mono_ns
    assert third.boot_id > first.boot_id
    third.leave()


def test_a_start_takes_away_what_the_dead_left(tmp_path: Path) -> None:
    run = tmp_path / "run"
    for path in (run / "apps/pilot#1.toml", run / "apps/pilot#1.dead", run / "p/7-1.sock"):
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        path.touch()
    run.chmod(0o700)
    boot = NodeIncarnation(run, tmp_path / "shm")
    assert [path for path in run.rglob("*") if path.is_file()] == [run / "boot"]
    boot.leave()


def test_signal_ends_modules_in_order_then_resets(
    tmp_path: Path,
) -> None:
    folder = make_node(tmp_path)
    left: list[str] = []

    async def program() -> None:
        async with Module("planner", config_dir=folder):
            async with Module("pilot", config_dir=folder):
                pass
            try:
                os.kill(os.getpid(), signal.SIGTERM)
                await asyncio.Event().wait()
            finally:
                left.append("planner")

    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit) as ended:
        asyncio.run(program())
    assert (ended.value.code, left) == (128 + signal.SIGTERM, ["planner"])
    assert signal.getsignal(signal.SIGTERM) is before
