"""The queue of a link that falls to a tenth of its rate under load, or is slow from the start."""

import pytest
from tests.integration.broker.namespace import figures_of


@pytest.mark.root
@pytest.mark.parametrize("options", [(), ("--at-once",)], ids=["falls", "slow from the start"])
def test_frames_taken_by_tcp_leave_queue_of_link(options: tuple[str, ...]) -> None:
    seen = figures_of("falling.py", "3", *options, tools=("ip", "tc"))
    # 160 to 200 ms; with larger buffers 0.6 to 1 s. Bytes in the queue depend little on the processor
    assert seen["fall_queue_ms"] < 400
    assert seen["slow_queue_ms"] < 400
    assert seen["slow_boards"] > 0
    assert "datagrams_after_s" in seen, "the queue was seen, although nothing is lost"
