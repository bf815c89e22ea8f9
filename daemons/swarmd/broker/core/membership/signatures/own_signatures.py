"""Signatures of the own beacons: each one has its own, which also proves each of its values to others."""

from collections.abc import Iterable
from typing import Protocol

from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import BoardValue, decode_age, encode_age
from swarmd.broker.core.beacon.parts import value_proof
from swarmd.broker.core.beacon.parts.beacon_signature import encode_statement


class SigningKeys(Protocol):
    """The own signing key, and the public keys of the members."""

    @property
    def is_open(self) -> bool:
        """Whether there are no keys."""
        ...

    def sign(self, data: bytes) -> bytes:
        """Signature by this node."""
        ...

    def sign_public_of(self, platform: str) -> bytes | None:
        """Public key of a member, or None for a platform that is not a valid member."""
        ...


class OwnSignatures:
    """Signs the beacons of one session of this node."""

    def __init__(self, own_hw: int, session: int, keys: SigningKeys) -> None:
        self._own_hw = own_hw
        self._session = session
        self._keys = keys

    def signed(
        self, clear: bytes, body: bytes | bytearray, values: Iterable[BoardValue], clock_us: int
    ) -> bytes:
        """The body of a beacon with its signature behind it.

        `clear`: its clear header, whose time is the low half of `clock_us`; `values`: the values in the body.
        """
        stated = codec.append_statement(body, encode_statement(clock_us))
        leaves = [
            value_proof.value_hash(  # with the stamp that receivers compute
                value.data_id, clock_us - decode_age(encode_age(value.age_us)), value.packed, value.payload
            )
            for value in values
        ]
        proof = value_proof.prove(self._session, value_proof.body_hash(clear, stated), leaves, b"")
        return stated + self._keys.sign(proof.signed_content(self._own_hw))
