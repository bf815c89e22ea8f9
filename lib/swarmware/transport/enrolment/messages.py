"""Messages of a join, sealed with keys of the invitation: request, answer and receipt, and the file.

All are `<4 bytes: kind> <8 bytes: number of the invitation> <12 bytes: nonce> <sealed MessagePack>`; an
inviter that does not know the number answers in clear text.
"""

from enum import IntEnum
from typing import Final, TypeVar

import msgspec

from swarmware.errors import WireError
from swarmware.transport.enrolment.token import ID_BYTES, JoinToken
from swarmware.transport.sodium import NONCE_BYTES, SealKey

T = TypeVar("T", bound=msgspec.Struct)

REQUEST_MAX: Final = 1024
"""Maximum bytes of a request; the longest platform makes one of 210."""
ANSWER_MAX: Final = 4 << 20
"""Maximum bytes of an answer: the roster of 10 000 members has 3 MB."""
SIZE_BYTES: Final = 4
"""Each message on a connection follows its size, a big-endian number of this many bytes."""

_REQUEST: Final = b"SWJ1"
_ANSWER: Final = b"SWA1"
_REFUSED: Final = b"SWR1"
_RECEIPT: Final = b"SWK1"
_FILE: Final = b"SWF1"
_KIND_BYTES: Final = 4
_SEALED: Final = _KIND_BYTES + ID_BYTES + NONCE_BYTES


class JoinRefusal(IntEnum):
    """Why a request to join was refused."""

    UNKNOWN = 1
    """The inviter has no invitation of this number."""
    USED = 2
    """Another node has joined with the token."""
    EXPIRED = 3
    """The token has expired, by the inviter's clock."""
    OTHER_PLATFORM = 4
    """The invitation is of another platform than the node that asks."""
    PROOF = 5
    """The node does not hold the key that it presented."""
    BUSY = 6
    """The inviter had too many requests."""
    FAILED = 7
    """The inviter could not sign the new roster."""
    ENDED = 8
    """The command that made the invitation has ended before."""


class JoinRequest(msgspec.Struct, frozen=True, array_like=True):
    """A node asks to be admitted."""

    platform: str
    sign_public: bytes
    """Ed25519 public key of the node's new identity."""
    proof: bytes
    """Proof that the node holds the key, made by `proof_of`."""


class JoinAnswer(msgspec.Struct, frozen=True, array_like=True):
    """The inviter admits a node, or refuses it."""

    utc_ns: int
    """Wall clock of the inviter."""
    refusal: int = 0
    """A `JoinRefusal`, or 0 for an admission."""
    reason: str = ""
    root_public: bytes = b""
    roster: bytes = b""
    """The roster with the new member, as the root signed it."""
    broker_port: int = 0
    """UDP port of the broker on the inviter's computer, or 0 without a fixed one."""


class JoinReceipt(msgspec.Struct, frozen=True, array_like=True):
    """The node has written the credentials of the answer to its folder of keys."""


class JoinFile(msgspec.Struct, frozen=True, array_like=True):
    """Credentials that the inviter made for a node, in a file."""

    platform: str
    seed: bytes
    root_public: bytes
    roster: bytes


def seal_request(token: JoinToken, nonce: bytes, request: JoinRequest) -> bytes:
    """The bytes of a request; `nonce`: 12 random bytes."""
    return _seal(_REQUEST, token, nonce, request)


def open_request(token: JoinToken, data: bytes) -> JoinRequest:
    """The request in the bytes. Raises: WireError."""
    return _open(_REQUEST, token, data, JoinRequest)


def seal_answer(token: JoinToken, nonce: bytes, answer: JoinAnswer) -> bytes:
    """The bytes of an answer; `nonce`: 12 random bytes."""
    return _seal(_ANSWER, token, nonce, answer)


def open_answer(token: JoinToken, data: bytes) -> JoinAnswer | JoinRefusal:
    """The answer in the bytes, or the reason in a clear-text one, which any computer may have sent.

    Raises: WireError.
    """
    if data[:_KIND_BYTES] == _REFUSED and len(data) == _KIND_BYTES + 1:
        try:
            return JoinRefusal(data[-1])
        except ValueError as error:
            raise WireError(f"an answer to a join: refusal {data[-1]}, which is not known here") from error
    return _open(_ANSWER, token, data, JoinAnswer)


def refuse(refusal: JoinRefusal) -> bytes:
    """A refusal in clear text, where no secret is in common."""
    return _REFUSED + bytes([refusal])


def seal_receipt(token: JoinToken, nonce: bytes) -> bytes:
    """The bytes of a receipt; `nonce`: 12 random bytes."""
    return _seal(_RECEIPT, token, nonce, JoinReceipt())


def open_receipt(token: JoinToken, data: bytes) -> JoinReceipt:
    """The receipt in the bytes. Raises: WireError."""
    return _open(_RECEIPT, token, data, JoinReceipt)


def seal_file(token: JoinToken, nonce: bytes, content: JoinFile) -> bytes:
    """The bytes of a file of credentials; `nonce`: 12 random bytes."""
    return _seal(_FILE, token, nonce, content)


def open_file(token: JoinToken, data: bytes) -> JoinFile:
    """The credentials in the bytes of a file. Raises: WireError."""
    return _open(_FILE, token, data, JoinFile)


def number_of(data: bytes) -> bytes:
    """Number of the invitation that a request is about. Raises: WireError when it is not a request."""
    if len(data) > REQUEST_MAX or len(data) < _SEALED or data[:_KIND_BYTES] != _REQUEST:
        raise WireError("not a request to join")
    return data[_KIND_BYTES : _KIND_BYTES + ID_BYTES]


def _seal(kind: bytes, token: JoinToken, nonce: bytes, content: msgspec.Struct) -> bytes:
    clear = kind + token.number
    # a key for each kind, so that no message can be replayed as another kind
    box = SealKey(token.key(kind)).seal(nonce, msgspec.msgpack.encode(content), clear)
    return clear + nonce + box


def _open(kind: bytes, token: JoinToken, data: bytes, cls: type[T]) -> T:
    clear, nonce, box = data[: _KIND_BYTES + ID_BYTES], data[_KIND_BYTES + ID_BYTES : _SEALED], data[_SEALED:]
    # cheap checks first: bytes from any computer arrive here
    if clear != kind + token.number or len(nonce) < NONCE_BYTES:
        raise WireError("a message of a join: of another token, or damaged")
    body = SealKey(token.key(kind)).open(nonce, box, clear)
    if body is None:
        raise WireError("a message of a join: not sealed with this token, or changed on its way")
    try:
        return msgspec.msgpack.decode(body, type=cls)
    except (msgspec.DecodeError, RecursionError) as error:
        raise WireError(f"a message of a join: {error}") from error
