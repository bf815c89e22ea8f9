"""When a node signs its own beacons, and what the signature states."""

from typing import Final

import pytest
from tests.unit.broker.signed_beacons import Member

from swarmd.broker.core.admission.own_signatures import ALL_NS, PERIOD_NS, SLACK_NS
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon import beacon_signature
from swarmd.broker.core.beacon.beacon import Beacon, RouteRow
from swarmd.broker.core.beacon.beacon_signature import PART_BYTES
from swarmware.errors import WireError

MS: Final = 1_000_000
PERIOD: Final = 100 * MS


def signed_at(member: Member, start_ns: int, count: int, first: int = 1) -> list[int]:
    """The steps of 0.1 s at which a beacon is signed."""
    return [
        step
        for step in range(count)
        if member.beacon(first + step, start_ns + step * PERIOD).beacon.signature is not None
    ]


def test_one_beacon_in_five_seconds_is_signed() -> None:
    assert signed_at(Member("uav1"), 0, 120) == [0, 50, 100]


def test_every_beacon_of_a_node_that_sends_rarely_is_signed() -> None:
    member = Member("uav1")
    assert all(member.beacon(step, step * PERIOD_NS).beacon.signature for step in range(1, 5))


def test_a_wish_signs_the_next_beacon_and_no_other() -> None:
    member = Member("uav1")
    signed_at(member, 0, 10)
    assert member.signatures.reserved_bytes(10 * PERIOD, must_sign=True)
    assert signed_at(member, 10 * PERIOD, 5, 11) == [0]


def test_after_a_raise_of_its_number_the_next_beacon_is_signed() -> None:
    member = Member("uav1")
    signed_at(member, 0, 10)
    assert member.beacon(5000, 10 * PERIOD).beacon.signature is None
    assert signed_at(member, 11 * PERIOD, 3, 5001) == [0]


def test_while_all_are_signed_each_states_for_how_long_and_no_longer_than_that_is_true() -> None:
    member = Member("uav1")
    signed_at(member, 0, 10)
    assert member.signatures.sign_all(10 * PERIOD)
    assert not member.signatures.sign_all(10 * PERIOD), "it does already"
    stated_ns = 0
    for step in range(10, 700):
        signature = member.beacon(step + 1, step * PERIOD).beacon.signature
        if step * PERIOD <= 10 * PERIOD + ALL_NS + SLACK_NS:
            assert signature is not None
            if signature.signs_all_s:
                stated_ns = max(stated_ns, step * PERIOD + signature.signs_all_s * 1_000_000_000)
    assert 10 * PERIOD + ALL_NS - 1_000_000_000 <= stated_ns <= 10 * PERIOD + ALL_NS
    assert len(signed_at(member, 700 * PERIOD, 100, 701)) == 2, "afterwards as before"


def test_another_content_with_a_used_number_is_recognised() -> None:
    member = Member("uav1")
    own = member.beacon(5, 0)
    assert not member.signatures.is_other(5, own.datagram.digest)
    assert member.signatures.is_other(5, own.datagram.digest + 1)
    assert not member.signatures.is_other(4, 1), "never used, or too old"


def test_a_signature_has_its_stated_size_and_does_not_change_the_rest() -> None:
    member = Member("uav1")
    bare = codec.encode(Beacon(rows=(RouteRow(9, 1, 256),)))
    body = member.signatures.signed(7, b"clear", bare, (), 0)
    assert len(body) == len(bare) + PART_BYTES
    found = codec.decode(body)
    assert found.signature is not None
    assert found.rows == (RouteRow(9, 1, 256),)
    assert found.signature.signed_bytes == len(body) - 64


@pytest.mark.parametrize("length", [0, 5, 68, 70])
def test_a_signature_that_is_cut_short_or_odd_is_not_a_body(length: int) -> None:
    part = bytes((beacon_signature.SIGNATURE,)) + length.to_bytes(2, "little") + bytes(length)
    with pytest.raises(WireError, match="signature is not its last part"):
        codec.decode(codec.append_statement(codec.encode(Beacon()), part))


def test_a_part_behind_the_signature_makes_the_body_invalid() -> None:
    body = Member("uav1").signatures.signed(7, b"clear", codec.encode(Beacon()), (), 0)
    with pytest.raises(WireError, match="signature is not its last part"):
        codec.decode(codec.append_statement(body, bytes((99, 0, 0))))
