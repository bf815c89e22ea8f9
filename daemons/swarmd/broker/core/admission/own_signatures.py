"""Signatures of the own beacons: every one where the roster says so, or while another member forges some;
otherwise one every few seconds."""

from collections.abc import Iterable
from typing import Final

from swarmd.broker.core.admission.signing_keys import SigningKeys
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon import beacon_signature, value_proof
from swarmd.broker.core.beacon.beacon import NEVER_NS, BoardValue, decode_age, encode_age
from swarmd.broker.core.beacon.beacon_history import BeaconHistory
from swarmd.broker.core.beacon.beacon_signature import PART_BYTES, VALUE_PART_BYTES, signed_content

PERIOD_NS: Final = 5_000_000_000
"""Period of signatures: 17 B/s, which the budget of beacons has left (tests/bench/pose_ages.py)."""
EARLY_NS: Final = 50_000_000
"""A beacon is signed up to half a period of 10 Hz before that."""
ALL_NS: Final = 60_000_000_000
"""Time for which every beacon is signed after the last evidence of a false one."""
SLACK_NS: Final = 2_000_000_000
"""Every beacon is signed for this time longer than stated: receivers count from their reception."""
_SECOND_NS: Final = 1_000_000_000


class OwnSignatures:
    """Decides which own beacons are signed, and signs them."""

    def __init__(self, own_hw: int, session: int, keys: SigningKeys) -> None:
        self._own_hw = own_hw
        self._session = session
        self._keys = keys
        self._history = BeaconHistory()
        self._signed_ns = NEVER_NS
        self._all_until_ns = NEVER_NS
        self._is_asked = False
        self.always = False
        """Whether every beacon is signed, because the roster says so."""

    def sign_all(self, now_ns: int) -> bool:
        """Has every beacon signed for ALL_NS; whether that begins now."""
        begins = not self.signs_all(now_ns)
        self._all_until_ns = now_ns + ALL_NS
        return begins

    def signs_all(self, now_ns: int) -> bool:
        """Whether every beacon is signed now."""
        return self.always or now_ns <= self._all_until_ns + SLACK_NS

    def reserved_bytes(self, now_ns: int, *, must_sign: bool = False) -> int:
        """Bytes that the signature of the next beacon needs; 0: it is not signed. `must_sign`: it has to be,
        for what it answers."""
        self._is_asked = self._is_asked or must_sign
        if self.always:
            return VALUE_PART_BYTES
        is_due = self._is_asked or now_ns - self._signed_ns >= PERIOD_NS - EARLY_NS
        return PART_BYTES if is_due or self.signs_all(now_ns) else 0

    def signed(
        self,
        sequence: int,
        clear: bytes,
        body: bytes | bytearray,
        values: Iterable[BoardValue],
        tx_ns: int,
    ) -> bytes:
        """The body of a beacon with its signature behind it; `clear`: its clear header, `values`: of the
        body."""
        self._is_asked, self._signed_ns = False, tx_ns
        if self.always:  # as long as stated also after a change
            self._all_until_ns = tx_ns + ALL_NS
            return self._with_proof(clear, body, values, tx_ns // 1000)
        salt = self._salt(sequence)
        groups = tuple(group or 0 for group in self._history.groups(salt, sequence))
        statement = beacon_signature.encode_statement(self._left_s(tx_ns), salt, groups)
        stated = codec.append_statement(body, statement)
        return stated + self._keys.sign(signed_content(self._own_hw, self._session, clear, stated))

    def _with_proof(
        self, clear: bytes, body: bytes | bytearray, values: Iterable[BoardValue], clock_us: int
    ) -> bytes:
        """The body with a signature that proves each value; their stamps are as receivers compute them."""
        statement = beacon_signature.encode_value_statement(self._left_s(clock_us * 1000), clock_us)
        stated = codec.append_statement(body, statement)
        hashed = value_proof.body_hash(clear, stated)
        leaves = [
            value_proof.value_hash(
                value.data_id, clock_us - decode_age(encode_age(value.age_us)), value.packed, value.payload
            )
            for value in values
        ]
        proof = value_proof.prove(self._session, hashed, leaves, b"")
        return stated + self._keys.sign(proof.signed_content(self._own_hw))

    def _left_s(self, now_ns: int) -> int:
        left_s = max(0, self._all_until_ns - now_ns) // _SECOND_NS
        return min(left_s, beacon_signature.SECONDS_MAX)

    def _salt(self, sequence: int) -> int:
        """A number that no other node can compute before this beacon; digests of earlier ones need it."""
        secret = self._keys.sign(signed_content(self._own_hw, self._session, b"salt", sequence.to_bytes(4)))
        return int.from_bytes(secret[:4])

    def on_sent(self, sequence: int, digest: int) -> None:
        """Remembers a sent beacon."""
        if 0 <= self._history.top < sequence - 1:
            self._is_asked = True  # receivers take the raised number only with a signature
        self._history.record(sequence, digest)

    def is_other(self, sequence: int, digest: int) -> bool:
        """Whether a datagram with a number that was used has another content than the own one."""
        own = self._history.digest(sequence)
        return own is not None and own != digest
