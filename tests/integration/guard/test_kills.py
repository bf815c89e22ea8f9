"""A handful of the trials of `kills.py`, one of each kind; many are made by running that file."""

import asyncio
from pathlib import Path

from tests.integration.guard.kills import LIMIT_S, TRIALS, run, summary
from tests.integration.swarm.starts import Starts

SEED = 3
STARTS = 8.0
"""On a busy machine: within so many starts of one daemon from scratch, measured between the trials."""


def test_a_node_is_whole_again_in_five_seconds_whatever_dies_together_or_is_damaged(tmp_path: Path) -> None:
    said: list[str] = []
    starts = Starts(tmp_path)
    took_s = asyncio.run(run(tmp_path, list(TRIALS), SEED, said.append, starts.measure))
    limit_s = max(LIMIT_S, STARTS * starts.slowest_s)
    print("\n".join([*said, summary(took_s), f"limit {limit_s:.2f} s"]))
    assert len(took_s) == len(TRIALS)
    assert max(took_s) < limit_s, said
