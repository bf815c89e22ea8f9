"""The replay window of a simulated node, whose datagrams have no seals."""

from swarmd.broker.core.admission.sources import Sources
from swarmd.broker.core.beacon.beacon import Header
from swarmware.transport.security.seal import REPLAY_WINDOW


class ReplayWindow:
    """Takes each number of a session once, as `ReceivedSession` does."""

    def __init__(self) -> None:
        self._used: set[int] = set()
        self._top = -1

    def is_new(self, header: Header, digest: int, sources: Sources, now_ns: int) -> bool | None:
        """Whether the window takes a datagram; None: it is refused as a replay."""
        if sources.is_ahead(header, now_ns):
            return False
        number = header.sequence
        if number in self._used or number <= self._top - REPLAY_WINDOW:
            return False if sources.is_other(header, digest) else None
        self._used.add(number)
        self._top = max(self._top, number)
        return True

    def resume(self, sequence: int) -> None:
        """Begins again behind this number."""
        self._top = sequence
        self._used = set(range(sequence - REPLAY_WINDOW, sequence + 1))
