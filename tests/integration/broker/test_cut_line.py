"""A cut line between real brokers is noticed, gone around, and used again."""

from pathlib import Path

from tests.integration.broker.cut_line import cut_and_heal
from tests.integration.broker.swarm import on_uvloop


@on_uvloop
async def test_frames_detour_around_cut_line_and_return(tmp_path: Path) -> None:
    found = await cut_and_heal(tmp_path)
    # the goals are 1.5 s, 2 s and 1 s (tests/bench/link_loss.py); a busy computer delays this process
    assert found["noticed_s"] < 5
    assert found["rerouted_s"] < 8
    assert found["back_s"] < 5
    assert found["direct_s"] < 8
