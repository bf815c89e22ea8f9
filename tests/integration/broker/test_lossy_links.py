"""Messages and streams over a loopback of the kernel that drops packets."""

import pytest
from tests.integration.broker.namespace import figures_of


@pytest.mark.root
@pytest.mark.parametrize("percent", [30, 40])
def test_lossy_link_delivers_everything_once_in_time(percent: int) -> None:
    seen = figures_of("lossylink.py", str(percent), tools=("ip", "nft"))
    assert seen["delivered"] == seen["told"]
    assert seen["items"] == seen["items_acknowledged"] == seen["offered"]
    assert seen["twice"] == 0
    assert seen["p50_s"] < 0.5, "over TCP half of them took ten seconds at this loss"
    assert seen["item_p50_s"] < 0.5
    loss = percent / 100
    assert 0 < seen["repeated_bytes"] < 4 * loss / (1 - loss) * 1100 * seen["offered"]
    assert seen["tcp_bytes"] < 0.1 * seen["udp_bytes"], "frames travel in datagrams"
