"""Table of the sessions, which admits new sessions and finds the session of a received packet."""

from typing import Generic, NamedTuple, TypeVar

from swarmd.video.core import rtcp, rtp_packet
from swarmd.video.core.receiver import receiver_ssrc
from swarmware.errors import Conflict, OutOfRange, WireError

Sent = TypeVar("Sent")
Received = TypeVar("Received")


class Addressed(NamedTuple):
    """Session of a received packet, and the end to which the packet is addressed."""

    session: int
    to_sender: bool
    """True for a report about the packets of the session, False for a packet of the session itself."""


def addressed(data: bytes) -> Addressed:
    """Finds the session number in an RTP or RTCP packet. Raises: WireError."""
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
    """Key of a received session; different senders may choose the same number."""

    sender_hw: int
    session: int


class SessionTable(Generic[Sent, Received]):
    """Sent and received sessions of a node, with their names."""

    def __init__(self, sessions_max: int) -> None:
        """`sessions_max`: limit of the sent sessions, and of the received sessions."""
        self.sent: dict[int, Sent] = {}
        self.received: dict[SessionKey, Received] = {}
        self.refused = 0
        """Number of packets that belong to no session."""
        self._names: dict[int | SessionKey, tuple[str, str]] = {}
        self._receivers: dict[int, int] = {}
        """Hardware id of the receiver, for each session to a platform."""
        self._sessions_max = sessions_max

    def check_sent(self, source: str, to: str) -> None:
        """Checks that another session may be sent. Raises: Conflict, OutOfRange."""
        if (source, to) in (self._names.get(number) for number in self.sent):
            raise Conflict(f"{source}: sent to {to} already; expected `video stop` before")
        self._check_room(len(self.sent))

    def number_sent(self, source: str, to: str) -> int | None:
        """Number of the session that sends this source to this receiver, or None."""
        return next((number for number in self.sent if self._names.get(number) == (source, to)), None)

    def names_sent(self) -> list[tuple[str, str]]:
        """Source and receiver of each sent session."""
        return [self._names[number] for number in self.sent]

    def add_sent(self, number: int, source: str, to: str, receiver_hw: int | None, session: Sent) -> None:
        """Adds a sent session; `receiver_hw` is None if the receiver is an address."""
        self.sent[number] = session
        if receiver_hw is not None:
            self._receivers[number] = receiver_hw
        self._names[number] = (source, to)

    def replaced(self, source: str, sender: str) -> SessionKey | None:
        """Key of the received session that a new session of the same source replaces, or None.

        Raises: OutOfRange when no session is replaced and the table is full.
        """
        for key in self.received:
            # by name: a restarted sender has chosen another number
            if self._names.get(key) == (source, sender):
                return key
        self._check_room(len(self.received))
        return None

    def add_received(self, key: SessionKey, source: str, sender: str, session: Received) -> None:
        """Adds a received session."""
        self.received[key] = session
        self._names[key] = (source, sender)

    def remove(self, key: int | SessionKey) -> None:
        """Removes a session that has ended."""
        self._names.pop(key, None)
        if isinstance(key, SessionKey):
            self.received.pop(key, None)
        else:
            self.sent.pop(key, None)
            self._receivers.pop(key, None)

    def find(self, data: bytes, sender_hw: int) -> Sent | Received | None:
        """Session of a packet from this node, or None for a packet that is refused and counted."""
        try:
            number, to_sender = addressed(data)
        except WireError:
            self.refused += 1
            return None
        found = None if to_sender else self.received.get(SessionKey(sender_hw, number))
        if found is not None:
            return found
        if not to_sender:
            number = receiver_ssrc(number)  # the receiver ends the session, under its own derived number
        # only the receiver of a session may send reports about it
        if self._receivers.get(number) != sender_hw:
            self.refused += 1
            return None
        return self.sent[number]

    def _check_room(self, count: int) -> None:
        if count >= self._sessions_max:
            raise OutOfRange(
                f"{count} video sessions already: expected at most {self._sessions_max} (sessions_max)"
            )
