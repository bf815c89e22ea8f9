"""Times of the exchange with other nodes."""

from typing import Final

import msgspec

from swarmware.runtime.own_delay import OwnDelay

PATIENCE: Final = 4
"""Delays of the own event loop by which a wait for another node is longer: the question and its answer pass
the event loops of both nodes."""


class ReplicaTimeouts(msgspec.Struct, frozen=True, kw_only=True):
    """Lease, retry and retention times of replicas."""

    lease_ns: int
    retry_ns: tuple[int, ...]
    """Pauses after failures in a row."""
    forget_ns: int
    delay: OwnDelay
    broadcast_ns: int
    """Time to wait for a structure in a beacon, before it is requested; 0: it is requested at once."""
    whole_swarm: bool = False
    """Follow every platform; else neighbours, and those with a subscription."""

    def structure_due_ns(self, now_ns: int) -> int:
        """When a structure that no beacon has brought is requested; later where the own node is late."""
        return now_ns + self.broadcast_ns + PATIENCE * self.delay.recent_ns(now_ns)
