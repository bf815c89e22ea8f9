"""ZMTP 3.1 with mechanism NULL: bytes of a stream to messages of one part, and back.

Sans-io. Source: RFC 37 of ZeroMQ (rfc.zeromq.org/spec/37).
"""

from typing import Final

from swarmware.errors import WireError
from swarmware.model.frame import FRAME_LIMIT

_SIGNATURE: Final = b"\xff" + bytes(8) + b"\x7f"
_MECHANISM: Final = b"NULL" + bytes(16)
_GREETING: Final = _SIGNATURE + b"\x03\x01" + _MECHANISM + bytes(32)
_MAJOR: Final = 3
_MORE: Final = 1
_LONG: Final = 2
_LONG_HEAD: Final = 9
"""Flags and length of a long part."""
_COMMAND: Final = 4
_SHORT_MAX: Final = 255
_COMMAND_LIMIT: Final = 4096
"""Maximum bytes of a command: READY has a few properties."""
_PING_TTL_BYTES: Final = 2

ROUTER: Final = b"ROUTER"
"""Socket type of the binding side."""
DEALER: Final = b"DEALER"
"""Socket type of the connecting side."""
_PARTNERS: Final = {
    ROUTER: frozenset({b"DEALER", b"REQ", b"ROUTER"}),
    DEALER: frozenset({b"DEALER", b"REP", b"ROUTER"}),
}


class ZmtpConnection:
    """One end of a connection: pass received bytes to `receive`, and send the bytes that `take_output`
    returns."""

    def __init__(self, socket_type: bytes) -> None:
        self.is_ready = False
        """Both sides have sent READY, so messages may be sent."""
        self.ignored = 0
        """Number of received messages of several parts, which are dropped."""
        self.missing = 0
        """Missing bytes of a partially received message."""
        self.has_output = True
        """Whether `take_output` has bytes to send."""
        self._output = _GREETING
        self._socket_type = socket_type
        self._has_greeting = False
        self._in_parts = False
        self._buffer = bytearray()
        self._needed = 0
        """Minimum bytes in the buffer before it is parsed again."""

    def take_output(self) -> bytes:
        """Bytes to be sent before any further message: greeting, READY, answers to PING."""
        output, self._output = self._output, b""
        self.has_output = False
        return output

    def receive(self, data: bytes) -> list[bytes]:
        """Add received bytes; returns the messages that are complete now.

        Raises: WireError when the peer violates the protocol; the connection must then be closed.
        """
        if self.is_ready and not self._buffer and not self._in_parts:
            # the common case: exactly one complete message
            size = len(data)
            if data[0] == 0:
                if size > 1 and data[1] == size - 2:
                    return [data[2:]]
            elif data[0] == _LONG and size > _LONG_HEAD:
                length = size - _LONG_HEAD
                if length <= FRAME_LIMIT and int.from_bytes(data[1:_LONG_HEAD], "big") == length:
                    return [data[_LONG_HEAD:]]
        if self._buffer:
            self._buffer += data
            self.missing = max(0, self._needed - len(self._buffer))
            if self.missing:
                return []
            data = bytes(self._buffer)
            self._buffer.clear()
        start = 0 if self._has_greeting else self._take_greeting(data)
        messages: list[bytes] = []
        if start is not None:
            start = self._take_parts(data, start, messages)
        if start is None or start < len(data):
            self._buffer += data[start or 0 :]
            self.missing = max(0, self._needed - len(self._buffer))
        return messages

    def _take_greeting(self, data: bytes) -> int | None:
        """End of the greeting in the buffer, or None if it is not complete."""
        # checked from the first bytes on, so that another protocol is refused at once
        if data[:1] != b"\xff" or data[9:10] not in (b"", b"\x7f"):
            raise WireError(f"greeting starts with {data[:10].hex()}: expected ff, 8 bytes and 7f of ZMTP")
        if len(data) > len(_SIGNATURE) and data[len(_SIGNATURE)] < _MAJOR:
            raise WireError(f"ZMTP version {data[len(_SIGNATURE)]}: expected {_MAJOR} or above")
        if len(data) < len(_GREETING):
            self._needed = 0
            return None
        if data[12:32] != _MECHANISM:
            raise WireError(f"mechanism {data[12:32].rstrip(bytes(1))!r}: expected NULL")
        self._has_greeting = True
        properties = _property(b"Socket-Type", self._socket_type)
        if self._socket_type == DEALER:
            properties += _property(b"Identity", b"")
        ready = b"\x05READY" + properties
        self._output += bytes((_COMMAND, len(ready))) + ready
        self.has_output = True
        return len(_GREETING)

    def _take_parts(self, data: bytes, start: int, messages: list[bytes]) -> int:
        """Parse all complete parts from `start` on; returns the start of the incomplete one."""
        size = len(data)
        while start < size:
            flags = data[start]
            if flags > _MORE + _LONG + _COMMAND or (flags & _COMMAND and flags & _MORE):
                raise WireError(f"flags {flags:#04x} of a part: expected a message or a command")
            body = start + (_LONG_HEAD if flags & _LONG else 2)
            if body > size:
                self._needed = body - start
                break
            length = int.from_bytes(data[start + 1 : body], "big")
            # before the body arrives: a false length would make the buffer grow without end
            limit = _COMMAND_LIMIT if flags & _COMMAND else FRAME_LIMIT
            if length > limit:
                raise WireError(f"a part of {length} bytes: expected at most {limit}")
            end = body + length
            if end > size:
                self._needed = end - start
                break
            if flags & _COMMAND:
                self._take_command(data[body:end])
            elif not self.is_ready:
                raise WireError("a message before READY")
            elif flags & _MORE or self._in_parts:
                # parts are skipped up to the last one, whose flag ends the message
                self._in_parts = bool(flags & _MORE)
                self.ignored += not self._in_parts
            else:
                messages.append(data[body:end])
            start = end
        return start

    def _take_command(self, body: bytes) -> None:
        name_end = 1 + body[0] if body else 0
        if not 1 < name_end <= len(body):
            raise WireError(f"a command of {len(body)} bytes without a name")
        name, content = body[1:name_end], body[name_end:]
        if not self.is_ready:
            if name != b"READY":
                raise WireError(f"command {name!r}: expected READY")
            partner = _properties(content).get(b"socket-type", b"")
            if partner not in _PARTNERS[self._socket_type]:
                raise WireError(f"socket type {partner!r}: not compatible with {self._socket_type.decode()}")
            self.is_ready = True
        elif name == b"PING":
            pong = b"\x04PONG" + content[_PING_TTL_BYTES:]
            # the answer is a short command, as the standard limits the context of a PING to 16 bytes
            if len(pong) > _SHORT_MAX:
                raise WireError(f"PING of {len(content)} bytes: expected at most 18")
            self._output += bytes((_COMMAND, len(pong))) + pong
            self.has_output = True


def message(data: bytes) -> bytes:
    """Encode a message of one part."""
    length = len(data)
    if length <= _SHORT_MAX:
        return bytes((0, length)) + data
    return b"\x02" + length.to_bytes(8, "big") + data


def _property(name: bytes, value: bytes) -> bytes:
    return bytes((len(name),)) + name + len(value).to_bytes(4, "big") + value


def _properties(content: bytes) -> dict[bytes, bytes]:
    """Properties of a READY command by their names in lower case.

    Raises: WireError.
    """
    found: dict[bytes, bytes] = {}
    at = 0
    while at < len(content):
        value_at = at + 1 + content[at] + 4
        end = value_at + int.from_bytes(content[value_at - 4 : value_at], "big")
        if end > len(content):
            raise WireError(f"READY with {len(content)} bytes of properties: one ends behind them")
        found[content[at + 1 : value_at - 4].lower()] = content[value_at:end]
        at = end
    return found
