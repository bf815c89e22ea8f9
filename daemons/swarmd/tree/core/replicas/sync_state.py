"""How much of the trees that are followed agrees here."""

import msgspec


class SyncState(msgspec.Struct, frozen=True):
    """Synchronisation with the platforms that are followed and reachable."""

    followed: int
    structures: int
    """Those whose structure is current."""
    subscriptions: int
    """Those that hold the subscription of this platform."""
