"""The joining node's decisions: what it asks, and what it accepts as the answer of its swarm's root."""

from typing import Final

import msgspec

from swarmware.errors import Denied, InvalidInput, NotFound, SwarmError, WireError
from swarmware.transport.enrolment.messages import (
    JoinAnswer,
    JoinFile,
    JoinRefusal,
    JoinRequest,
    open_answer,
    open_file,
    seal_receipt,
    seal_request,
)
from swarmware.transport.enrolment.token import JoinToken, proof_of, root_digest
from swarmware.transport.sodium import SigningKey

UNSIGNED: Final = "unsigned: any computer may have sent it"
CLOCK_S: Final = 10.0
"""Difference of the two wall clocks above which the node warns."""
AGAIN: Final = "a new token: `swarmctl keys invite {platform}` at the operator's"

_REASONS: Final = {
    JoinRefusal.UNKNOWN: "the inviter does not know this token",
    JoinRefusal.USED: "the token was used",
    JoinRefusal.EXPIRED: "the token has expired",
    JoinRefusal.OTHER_PLATFORM: "the token is for another platform",
    JoinRefusal.PROOF: "the inviter refused the proof of the key",
    JoinRefusal.BUSY: "the inviter has too many requests; try again in a minute",
    JoinRefusal.ENDED: "the `keys invite` that made the token has ended",
    JoinRefusal.FAILED: "the inviter could not sign the roster",
}
_NEEDS_NEW: Final = {JoinRefusal.UNKNOWN, JoinRefusal.USED, JoinRefusal.EXPIRED, JoinRefusal.ENDED}


class Credentials(msgspec.Struct, frozen=True):
    """Credentials that a joined node writes to its folder of keys."""

    seed: bytes
    root_public: bytes
    roster: bytes
    """The signed roster; it is verified where it is decoded."""
    ahead_s: float | None = None
    """Wall clock of this node minus the inviter's, or None if unknown."""
    broker_port: int = 0
    """UDP port of the broker on the inviter's computer, or 0 without a fixed one."""
    inviter: str = ""
    """Address of the inviter's computer, or "" if the credentials came in a file."""


class Joiner:
    """One attempt of a node to join with a token."""

    def __init__(self, token: JoinToken, platform: str, seed: bytes) -> None:
        self._token = token
        self._platform = platform
        self._seed = seed

    def request(self, nonce: bytes) -> bytes:
        """The bytes of the request; `nonce`: 12 random bytes."""
        key = SigningKey(self._seed)
        proof = proof_of(key, self._token.fingerprint, self._platform)
        return seal_request(self._token, nonce, JoinRequest(self._platform, key.public, proof))

    def receipt(self, nonce: bytes) -> bytes:
        """The bytes of the receipt for credentials that were written; `nonce`: 12 random bytes."""
        return seal_receipt(self._token, nonce)

    def on_answer(self, data: bytes, utc_ns: int) -> Credentials | SwarmError:
        """The credentials in an answer, or a refusal in clear text, which any computer may have sent.

        `utc_ns`: this node's wall clock.
        Raises: Denied, NotFound, InvalidInput or SwarmError with the inviter's reason; WireError for an
        answer of any other computer.
        """
        answer = open_answer(self._token, data)
        if isinstance(answer, JoinRefusal):
            # returned, not raised: a forged refusal must not end the attempt before the true answer
            return self._refused(answer, f" ({UNSIGNED})")
        if answer.refusal:
            try:
                # an inviter of a later version may have further reasons
                refusal = JoinRefusal(answer.refusal)
            except ValueError as error:
                text = f"{answer.reason or 'for a reason that is not known here'}"
                raise Denied(f"the inviter refused {self._platform}: {text}") from error
            raise self._refused(refusal, answer.reason and f": {answer.reason}")
        # the seal shows only that the token is known; the fingerprint binds the answer to the root
        _check_root(self._token, answer.root_public)
        return Credentials(
            self._seed, answer.root_public, answer.roster, _ahead_s(answer, utc_ns), answer.broker_port
        )

    def _refused(self, refusal: JoinRefusal, more: str) -> SwarmError:
        text = f"{self._platform}: {_REASONS[refusal]}{more}"
        if refusal in _NEEDS_NEW:
            text += f"; expected {AGAIN.format(platform=self._platform)}"
        if refusal is JoinRefusal.OTHER_PLATFORM:
            return InvalidInput(f"{text}; `platform` of node.toml is {self._platform}")
        if refusal is JoinRefusal.UNKNOWN:
            return NotFound(text)
        if refusal in {JoinRefusal.BUSY, JoinRefusal.FAILED}:
            return SwarmError(text)
        return Denied(text)


def from_file(token: JoinToken, platform: str, data: bytes, source: str, utc_s: int) -> Credentials:
    """The credentials in a file that the inviter made; `utc_s`: this node's wall clock.

    Raises: Denied when the token has expired or belongs to another file or root, InvalidInput when the file
    is for another platform.
    """
    # a file has no inviter whose clock could decide
    if utc_s >= token.expires_utc_s:
        late_s = utc_s - token.expires_utc_s
        raise Denied(
            f"{source}: expired {late_s} s ago by this computer's clock; expected a clock that is right, or"
            f" {AGAIN.format(platform=platform)} --file"
        )
    try:
        content: JoinFile = open_file(token, data)
    except WireError as error:
        raise Denied(f"{source}: {error}; expected the file and the token of one invitation") from error
    # the roster has this key under the other name, so peers would refuse the node
    if content.platform != platform:
        raise InvalidInput(
            f"{source}: credentials of {content.platform}; `platform` of node.toml is {platform}"
        )
    _check_root(token, content.root_public)
    return Credentials(content.seed, content.root_public, content.roster)


def _check_root(token: JoinToken, root_public: bytes) -> None:
    if root_digest(root_public) != token.fingerprint:
        raise Denied(
            f"the root {root_digest(root_public).hex()} is not the one of the token,"
            f" {token.fingerprint.hex()}; expected the inviter that made the token"
        )


def _ahead_s(answer: JoinAnswer, utc_ns: int) -> float:
    return (utc_ns - answer.utc_ns) / 1e9
