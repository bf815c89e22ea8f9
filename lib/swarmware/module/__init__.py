"""What a functional module holds in its hands: boards, streams, inboxes, requests.

One file a noun; nothing here knows sockets or maps, that is the node's.
"""

from swarmware.module.board import BoardReader
from swarmware.module.boardset import BoardSet
from swarmware.module.inbox import Inbox
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.stream import StreamReader
from swarmware.module.streamwriter import StreamWriter
from swarmware.module.ticker import Ticker
from swarmware.module.writer import BoardWriter, Loan

__all__ = [
    "BoardReader",
    "BoardSet",
    "BoardWriter",
    "Inbox",
    "Loan",
    "Meta",
    "Module",
    "StreamReader",
    "StreamWriter",
    "Ticker",
]
