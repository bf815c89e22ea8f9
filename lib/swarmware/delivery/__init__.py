"""Delivery of messages and requests, as decisions only: what to send, what to answer, what became of it.

Sans-io: time is an argument, no sockets, no clock. `swarmware.post` carries out what comes back.
"""

from swarmware.delivery.answer import answer, answerable, expired, expired_here, reply, with_lifetime
from swarmware.delivery.duplicates import DuplicateFilter, DuplicateState
from swarmware.delivery.outbox import Action, Complete, Key, Outbox, Transmit
from swarmware.delivery.outcome import Outcome, Status
from swarmware.delivery.sender import arrival_ns, sender_of, with_sender

__all__ = [
    "Action",
    "Complete",
    "DuplicateFilter",
    "DuplicateState",
    "Key",
    "Outbox",
    "Outcome",
    "Status",
    "Transmit",
    "answer",
    "answerable",
    "arrival_ns",
    "expired",
    "expired_here",
    "reply",
    "sender_of",
    "with_lifetime",
    "with_sender",
]
