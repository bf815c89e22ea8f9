"""Proofs of relayed values: where every beacon is signed, no member can invent a value of another one."""

from collections.abc import Callable
from typing import Final

from swarmd.broker.core.admission.signing_keys import SigningKeys
from swarmd.broker.core.beacon.beacon import RelayedValue
from swarmware.transport.sodium import verify

REMEMBERED: Final = 256
"""Signatures that are not verified again: values of one beacon come by several relays, and one after the
other."""


class RelayProofs:
    """Verifies that the origins of relayed values have sent them."""

    def __init__(self, keys: SigningKeys, platform_of: Callable[[int], str]) -> None:
        self._keys = keys
        self._platform_of = platform_of
        self._valid: dict[bytes, bytes] = {}
        """Signature → what it signs, the oldest one first."""
        self._required_from_ns: int | None = None

    def require(self, signs: bool, from_ns: int) -> None:
        """Takes what the roster says: whether members sign every beacon, so that no relayed value without a
        proof is taken from an instant on."""
        if not signs or self._required_from_ns is None:
            self._required_from_ns = from_ns if signs else None

    @property
    def is_used(self) -> bool:
        """Whether members sign every beacon."""
        return self._required_from_ns is not None

    def is_required(self, now_ns: int) -> bool:
        """Whether values without a proof are refused."""
        return self._required_from_ns is not None and now_ns >= self._required_from_ns

    def is_known(self, origin_hw: int) -> bool:
        """Whether the key of an origin is known."""
        return self._public(origin_hw) is not None

    def is_valid(self, relay: RelayedValue) -> bool:
        """Whether the origin of a relayed value signed it."""
        proof, public = relay.proof, self._public(relay.origin_hw)
        if proof is None or public is None:
            return False
        content = public + proof.signed_content(relay.origin_hw)
        if self._valid.get(proof.signature) == content:
            return True
        if not verify(public, proof.signature, content[len(public) :]):
            return False
        if len(self._valid) >= REMEMBERED:
            del self._valid[next(iter(self._valid))]
        self._valid[proof.signature] = content
        return True

    def _public(self, hw: int) -> bytes | None:
        return self._keys.sign_public_of(self._platform_of(hw))
