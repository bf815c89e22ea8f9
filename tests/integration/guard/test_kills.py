"""A few trials of `kills.py` and `steady_kills.py`; running these files makes many trials."""

import asyncio
from pathlib import Path

import pytest
from tests.integration.guard import steady_kills
from tests.integration.guard.kills import LIMIT_S, SERVICES, TRIALS, run, summary
from tests.integration.swarm.starts import Starts

SEED = 3
STARTS = 8.0
"""On a busy machine: within so many starts of one daemon from scratch, measured between the trials."""


def test_node_is_whole_five_seconds_after_any_death(tmp_path: Path) -> None:
    said: list[str] = []
    starts = Starts(tmp_path)
    took_s = asyncio.run(run(tmp_path, list(TRIALS), SEED, said.append, starts.measure))
    limit_s = max(LIMIT_S, STARTS * starts.slowest_s)
    print("\n".join([*said, summary(took_s), f"limit {limit_s:.2f} s"]))
    assert len(took_s) == len(TRIALS)
    assert max(took_s) < limit_s, said


@pytest.mark.parametrize(
    ("processes", "victims"), [("per-daemon", (*SERVICES[:6], "tree")), ("one", ("hal", "hal", "hal"))]
)
def test_daemon_killed_at_return_restarts_and_counts_once(
    tmp_path: Path, processes: steady_kills.Processes, victims: tuple[str, ...]
) -> None:
    said: list[str] = []
    starts = Starts(tmp_path)
    took_s = asyncio.run(steady_kills.run(tmp_path, processes, victims, said.append, between=starts.measure))
    limit_s = max(steady_kills.LIMIT_S, STARTS * starts.slowest_s)
    print("\n".join([*said, f"limit {limit_s:.2f} s"]))
    assert len(took_s) == len(victims)
    assert max(took_s) < limit_s, said
