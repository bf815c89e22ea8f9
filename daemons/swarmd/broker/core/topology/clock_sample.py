"""Clock sample: bounds of the offset between two clocks from one datagram."""

import msgspec


class ClockSample(msgspec.Struct, frozen=True, gc=False):
    """Clock differences of one datagram (share/doc/protocol.md, section 3.4): theirs minus ours."""

    hw: int
    boot_id: int
    rx_ns: int
    """Our clock at reception."""
    reverse_ns: int
    """Their clock at send minus ours at reception: the offset minus the delay to us."""
    forward_ns: int | None = None
    """Their clock at reception minus ours at send: the offset plus the delay to them."""
    forward_tx_ns: int = 0
    """Our clock at send of the echoed datagram."""
