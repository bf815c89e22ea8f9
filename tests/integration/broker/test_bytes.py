"""The counters against the bytes that the kernel saw."""

import pytest
from tests.integration.broker.namespace import figures_of


@pytest.mark.root
def test_counted_bytes_are_those_on_the_wire() -> None:
    seen = figures_of("onthewire.py", "80")
    assert seen["tcp"] > 100_000
    assert seen["udp"] > 5_000
    assert seen["sent"] == pytest.approx(seen["wire"], rel=0.03), seen
    # what one sent over TCP another received; a datagram to all is received by two
    assert seen["tcp_received"] == pytest.approx(seen["tcp"], rel=0.06), seen
    assert seen["udp_received"] == pytest.approx(2 * seen["udp"], rel=0.05), seen
