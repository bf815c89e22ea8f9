"""A handful of the trials of `kills.py`, one of each kind; many are made by running that file."""

import asyncio
from pathlib import Path

from tests.integration.guard.kills import LIMIT_S, TRIALS, run

SEED = 3


def test_a_node_is_whole_again_whatever_dies_together_or_is_damaged(tmp_path: Path) -> None:
    said: list[str] = []
    took = asyncio.run(run(tmp_path, list(TRIALS), SEED, said.append))
    print("\n".join(said))
    assert len(took) == len(TRIALS)
    # the limit is for a machine that does nothing else
    assert sorted(took)[len(took) // 2] < LIMIT_S, said
