"""Checks of signatures: a member can seal a beacon in the name of another one, or invent a value that it
relays, but it cannot sign either."""

from collections.abc import Callable
from enum import Enum
from typing import Final

import msgspec

from swarmd.broker.core.beacon.beacon import Beacon, Header, RelayedValue
from swarmd.broker.core.beacon.parts.value_proof import ValueProof, body_hash, prove, value_hash
from swarmd.broker.core.membership.signatures.own_signatures import SigningKeys
from swarmware.model.names import Address, hardware_id
from swarmware.transport.sodium import verify

REMEMBERED: Final = 256
"""Valid signatures that are not verified again: values of one beacon come by several relays, and one after
the other; a beacon comes over several media."""


class SignatureFault(Enum):
    """Why a beacon does not count as its sender's."""

    FALSE = 1
    """The signature is missing, or was made with another key."""
    UNKNOWN = 2
    """The key of the sender is not known, because its name or its admission is still to come."""


class CheckedDatagram(msgspec.Struct, frozen=True, gc=False):
    """A datagram whose seal is valid, so that a member made it, and whether that was its sender."""

    host: str
    """Source address, which its sender can falsify."""
    fault: SignatureFault | None = None
    proof: ValueProof | None = None
    """Proof of the values of the beacon for others, or None without keys."""

    @property
    def is_genuine(self) -> bool:
        """Whether its sender signed it, or nothing is signed here; its number is used then."""
        return self.fault is None


class UnsignedValue(msgspec.Struct, frozen=True, gc=False):
    """A relayed value without a valid proof: a member has invented it."""

    relay_hw: int
    origin_hw: int
    data_id: int


class SignatureChecks:
    """Verifies that beacons are of their senders, and relayed values of their origins."""

    def __init__(self, keys: SigningKeys, platform_of: Callable[[int], str], *, has_copies: bool) -> None:
        """`has_copies`: whether one beacon can come over several media."""
        self._keys = keys
        self._platform_of = platform_of
        self._has_copies = has_copies
        self._valid: dict[bytes, bytes] = {}
        """Signature → key and signed content, the oldest one first."""

    def on_datagram(
        self, header: Header, beacon: Beacon, clear: bytes, body: bytes, host: str
    ) -> CheckedDatagram:
        """Checks a beacon whose header names its session."""
        platform = self._platform_of(header.sender_hw)
        # the first beacon of a node introduces itself; the table of names does not have it yet
        if beacon.hello is not None and hardware_id(beacon.hello.name) == header.sender_hw:
            platform = Address.parse(beacon.hello.name).platform
        public = self._keys.sign_public_of(platform)
        if public is None:
            return CheckedDatagram(host, SignatureFault.UNKNOWN)
        proof = _proof(header, beacon, clear, body)
        if proof is None:
            return CheckedDatagram(host, SignatureFault.FALSE)
        if not self._is_valid(public, header.sender_hw, proof, remembers=self._has_copies):
            return CheckedDatagram(host, SignatureFault.FALSE)
        return CheckedDatagram(host, None, proof)

    def is_known(self, origin_hw: int) -> bool:
        """Whether the key of an origin is known."""
        return self._keys.sign_public_of(self._platform_of(origin_hw)) is not None

    def is_proven(self, relay: RelayedValue) -> bool:
        """Whether the origin of a relayed value signed it."""
        proof, public = relay.proof, self._keys.sign_public_of(self._platform_of(relay.origin_hw))
        return (
            proof is not None
            and public is not None
            and self._is_valid(public, relay.origin_hw, proof, remembers=True)
        )

    def _is_valid(self, public: bytes, hw: int, proof: ValueProof, *, remembers: bool) -> bool:
        content = proof.signed_content(hw)
        # relayed values share the signature of their beacon, and further media bring copies of it
        if self._valid.get(proof.signature) == public + content:
            return True
        if not verify(public, proof.signature, content):
            return False
        if remembers:
            if len(self._valid) >= REMEMBERED:
                del self._valid[next(iter(self._valid))]
            self._valid[proof.signature] = public + content
        return True


def _proof(header: Header, beacon: Beacon, clear: bytes, body: bytes) -> ValueProof | None:
    """The content that the signature of a beacon proves if it is valid, or None without a signature."""
    found = beacon.signature
    if found is None or header.session is None:
        return None
    clock_us = found.clock_high << 32 | header.tx_us
    leaves = [
        value_hash(value.data_id, clock_us - value.age_us, value.packed, value.payload)
        for value in beacon.values
    ]
    hashed = body_hash(clear, body[: found.signed_bytes])
    return prove(header.session, hashed, leaves, found.value)
