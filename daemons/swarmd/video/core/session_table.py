"""Which sessions may be, and whose a received packet is."""

from typing import Generic, NamedTuple, TypeVar

from swarmd.video.core import rtcp, rtp_packet
from swarmd.video.core.receiver import receiver_ssrc
from swarmware.errors import Conflict, OutOfRange, WireError

Sent = TypeVar("Sent")
Received = TypeVar("Received")


class Addressed(NamedTuple):
    """Whose a packet is."""

    session: int
    to_sender: bool
    """It is a report about what the session has sent."""


def addressed(data: bytes) -> Addressed:
    """The session of a packet, RTP or RTCP. Raises: WireError."""
    if not rtp_packet.is_rtcp(data):
        return Addressed(rtp_packet.decode(data).ssrc, False)
    for report in rtcp.decode(data):
        match report:
            case rtcp.SenderReport() | rtcp.Bye():
                return Addressed(report.ssrc, False)
            case _:
                return Addressed(report.source, True)
    raise WireError("RTCP: no report of a session")


class SessionKey(NamedTuple):
    """A received session: numbers of different senders may be equal."""

    sender_hw: int
    session: int


class SessionTable(Generic[Sent, Received]):
    """The sessions of a node."""

    def __init__(self, sessions_max: int) -> None:
        """`sessions_max`: of those sent, and of those received."""
        self.sent: dict[int, Sent] = {}
        self.received: dict[SessionKey, Received] = {}
        self.refused = 0
        """Packets of no session."""
        self._names: dict[int | SessionKey, tuple[str, str]] = {}
        self._receivers: dict[int, int] = {}
        """Hardware id of the receivers of sessions to platforms."""
        self._sessions_max = sessions_max

    def check_sent(self, source: str, to: str) -> None:
        """Check that another session may be sent. Raises: Conflict, OutOfRange."""
        if (source, to) in (self._names.get(number) for number in self.sent):
            raise Conflict(f"{source}: sent to {to} already; expected `video stop` before")
        self._check_room(len(self.sent))

    def number_sent(self, source: str, to: str) -> int | None:
        """The session that sends this source there; None: there is none."""
        return next((number for number in self.sent if self._names.get(number) == (source, to)), None)

    def names_sent(self) -> list[tuple[str, str]]:
        """Source and receiver of each session that is sent."""
        return [self._names[number] for number in self.sent]

    def add_sent(self, number: int, source: str, to: str, receiver_hw: int | None, session: Sent) -> None:
        """A session is sent from now on; `receiver_hw`: None: to an address."""
        self.sent[number] = session
        if receiver_hw is not None:
            self._receivers[number] = receiver_hw
        self._names[number] = (source, to)

    def replaced(self, source: str, sender: str) -> SessionKey | None:
        """The received session that another one of the same source replaces: its sender began again.

        Raises: OutOfRange when there is none and no room.
        """
        for key in self.received:
            if self._names.get(key) == (source, sender):
                return key
        self._check_room(len(self.received))
        return None

    def add_received(self, key: SessionKey, source: str, sender: str, session: Received) -> None:
        """A session is received from now on."""
        self.received[key] = session
        self._names[key] = (source, sender)

    def remove(self, key: int | SessionKey) -> None:
        """A session has ended."""
        self._names.pop(key, None)
        if isinstance(key, SessionKey):
            self.received.pop(key, None)
        else:
            self.sent.pop(key, None)
            self._receivers.pop(key, None)

    def find(self, data: bytes, sender_hw: int) -> Sent | Received | None:
        """The session of a packet from this node; None: it is refused, and counted."""
        try:
            number, to_sender = addressed(data)
        except WireError:
            self.refused += 1
            return None
        found = None if to_sender else self.received.get(SessionKey(sender_hw, number))
        if found is not None:
            return found
        if not to_sender:
            number = receiver_ssrc(number)  # the end of a session, from its receiver
        if self._receivers.get(number) != sender_hw:
            self.refused += 1
            return None
        return self.sent[number]

    def _check_room(self, count: int) -> None:
        if count >= self._sessions_max:
            raise OutOfRange(
                f"{count} video sessions already: expected at most {self._sessions_max} (sessions_max)"
            )
