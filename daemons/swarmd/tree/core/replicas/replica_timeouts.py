"""Times of the exchange with other nodes."""

import msgspec


class ReplicaTimeouts(msgspec.Struct, frozen=True, kw_only=True):
    """Lease, retry and retention times of replicas."""

    lease_ns: int
    retry_ns: tuple[int, ...]
    """Pauses after failures in a row."""
    forget_ns: int
    broadcast_ns: int
    """Time to wait for a structure in a beacon, before it is requested; 0: it is requested at once."""
    whole_swarm: bool = False
    """Follow every platform; else neighbours, and those with a subscription."""
