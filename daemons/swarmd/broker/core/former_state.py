"""What a broker knows of its former session when it starts."""

import msgspec


class FormerState(msgspec.Struct, frozen=True):
    """State of the former session of this node's broker."""

    declared_period_ns: int = 0
    """Longest time between two datagrams that it declared; 0: none is known."""
    quiet_ns: int = 0
    """Time for which other nodes may still route through it, in ns."""
