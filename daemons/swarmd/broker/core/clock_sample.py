"""What one datagram shows of two clocks."""

import msgspec


class ClockSample(msgspec.Struct, frozen=True, gc=False):
    """Clock differences read off one datagram (share/doc/protocol.md, section 3.4). Theirs minus ours."""

    hw: int
    boot_id: int
    rx_ns: int
    """Our clock at its arrival."""
    reverse_ns: int
    """Their clock at send minus ours at arrival: the offset less the way here."""
    forward_ns: int | None = None
    """Their clock at arrival minus ours at send: the offset plus the way there."""
    forward_tx_ns: int = 0
    """Our clock when the echoed datagram left."""
