"""The byte counters against the packets that a capture on the interface saw."""

import pytest
from tests.integration.broker.namespace import figures_of

ON_ITS_WAY_BYTES = 400
"""Beacons that were captured when the counters were read, and not received yet, or the reverse."""


@pytest.mark.root
@pytest.mark.parametrize("carrier", ["tcp", "udp"])
def test_every_counted_byte_is_on_the_wire(carrier: str) -> None:
    seen = figures_of("onthewire.py", "60", carrier)
    for what, (counted, captured) in seen.items():
        assert counted == pytest.approx(captured, rel=0.02, abs=ON_ITS_WAY_BYTES), (what, seen)
    carried = "uav1: tcp sent" if carrier == "tcp" else "uav1: link sent"
    assert seen[carried][1] > 50_000, "most bytes are those of frames"
    for name in ("uav1", "uav2"):
        assert seen[f"{name}: group sent"][1] > 1_000
