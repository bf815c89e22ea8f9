"""Beacons and commands on a link that is offered ten times its rate."""

import pytest
from tests.integration.broker.namespace import figures_of


@pytest.mark.root
def test_beacons_and_commands_pass_overload_of_slow_link() -> None:
    seen = figures_of("overload.py", "8", tools=("ip", "tc"))
    assert seen["offered_bit_s"] >= 10e6
    assert seen["by_datagram"], "its queue is seen, although nothing is lost"
    # of 40 commands the slowest: it has all of a moment in which the computer stands still
    assert seen["command_p99_ms"] < 4 * 300, "over TCP half of the commands took 233 ms, and more at 8 s"
    assert seen["beacon_p99_ms"] < 4 * 300
    assert max(seen["command_p50_ms"], seen["beacon_p50_ms"]) < 300
    assert seen["dropped"] > 0, "what is dropped counts where it was dropped"
    # 0.92 Mbit/s beside other work; a computer that stands still for moments shows as a queue, and costs rate
    assert seen["sent_bit_s"] > 0.4e6, "the link is used"
