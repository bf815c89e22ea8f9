"""A swarm whose roster says that every beacon is signed: nothing is taken of a node that it did not sign."""

from typing import Final

from tests.unit.broker.pair import PERIOD, Pair
from tests.unit.broker.signed_beacons import SESSION, Member

from swarmd.broker.core.admission.own_signatures import ALL_NS, SLACK_NS
from swarmd.broker.core.admission.sessions import ALIVE_NS, ENDED_NS, Sessions, digest
from swarmd.broker.core.admission.sources import ASK_AGAIN_NS, REMIND_NS
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Beacon
from swarmd.broker.core.beacon.beacon_signature import PART_BYTES, VALUE_PART_BYTES
from swarmd.broker.core.beacon.session_checks import CheckKind, SessionCheck

TRIES: Final = 1000
SECOND: Final = 1_000_000_000


def signed_pair() -> Pair:
    """A sender and a receiver that know the roster."""
    pair = Pair(steps=3)
    pair.victim.signatures.always = True
    pair.receiver.sources.require(True, 0)
    for _ in range(5):
        assert pair.true().is_taken
    return pair


def test_none_of_a_thousand_false_beacons_is_taken_and_each_is_evidence() -> None:
    pair = signed_pair()
    for number in range(TRIES):
        false = pair.false(pair.sequence + 1 + number % 40, signed=number % 2 == 0)
        assert not false.is_taken
        if false.refusal != "replayed":
            assert (false.refusal, false.is_evidence, false.suspects) == ("unsigned", True, ("10.0.0.9",))
            assert not false.forgets, "nothing of it was believed"
            assert false.ask is None, "it signs all already"
        if number % 10 == 0:
            true = pair.true()
            assert true.is_taken
            assert not true.is_evidence


def test_a_false_beacon_in_place_of_a_lost_one_is_not_taken_either() -> None:
    pair = signed_pair()
    for _ in range(50):
        pair.true(lost=True)
        assert not pair.false(pair.sequence).is_taken
    assert pair.true().is_taken


def test_a_node_that_left_the_range_is_not_taken_from_another_member() -> None:
    pair = signed_pair()
    for _ in range(130):
        pair.now_ns += PERIOD
        assert not pair.false(pair.sequence + 1).is_taken


def test_a_signature_of_a_node_whose_name_is_not_known_yet_is_no_evidence() -> None:
    pair = signed_pair()
    stranger = Member("uav9")  # its key is on no roster
    sent = stranger.beacon(pair.sequence + 1, pair.now_ns, signed=True)
    verdict = pair.receiver.take(sent, pair.now_ns)
    assert verdict is not None
    assert (verdict.is_taken, verdict.is_evidence) == (False, False)


def test_unsigned_beacons_are_taken_until_all_have_the_roster_and_not_after() -> None:
    pair = Pair()
    from_ns = pair.now_ns + SECOND
    pair.receiver.sources.require(True, from_ns)
    pair.receiver.sources.require(True, from_ns + 60 * SECOND)  # a further roster defers nothing
    while pair.now_ns + PERIOD < from_ns:
        assert pair.true(signed=False).is_taken
    refused = pair.true(signed=False)
    assert (refused.is_taken, refused.refusal, refused.is_evidence) == (False, "unsigned", False)


def test_a_node_that_does_not_know_the_roster_is_asked_to_sign_and_then_taken() -> None:
    pair = Pair()
    pair.receiver.sources.require(True, 0)
    asked: list[int] = []
    while not asked:
        verdict = pair.true(signed=False)
        assert not verdict.is_taken
        assert not verdict.is_evidence, "it never said that it signs all"
        if verdict.ask is CheckKind.SIGN:
            asked.append(pair.now_ns)
    assert pair.now_ns >= REMIND_NS
    again = pair.true(signed=False)
    assert again.ask is None
    assert pair.now_ns - asked[0] < ASK_AGAIN_NS
    pair.victim.signatures.sign_all(pair.now_ns)
    assert all(pair.true().is_taken for _ in range(100))


def test_when_it_is_switched_off_beacons_stay_signed_for_as_long_as_stated() -> None:
    pair = signed_pair()
    pair.victim.signatures.always = False
    pair.receiver.sources.require(False, 0)
    signed = 0
    for _ in range((ALL_NS + 10 * SECOND) // PERIOD):
        before = pair.victim.signatures.signs_all(pair.now_ns + PERIOD)
        verdict = pair.true()
        assert verdict.is_taken
        assert not verdict.is_evidence
        signed += before
    assert (ALL_NS - SECOND) // PERIOD <= signed <= (ALL_NS + SLACK_NS + SECOND) // PERIOD


def test_a_signature_on_each_beacon_has_no_digests_of_those_before() -> None:
    member = Member("uav1")
    member.signatures.always = True
    bare = codec.encode(Beacon())
    assert member.signatures.reserved_bytes(0) == VALUE_PART_BYTES == 70 < PART_BYTES
    for sequence in range(1, 20):
        body = member.signatures.signed(sequence, b"clear", bare, (), sequence * PERIOD)
        found = codec.decode(body).signature
        assert found is not None
        assert (found.groups, found.signs_all_s) == ((), ALL_NS // SECOND)
        assert len(body) - len(bare) == VALUE_PART_BYTES


def test_false_beacons_do_not_keep_a_session_that_has_ended() -> None:
    own, hw = 5, 9
    sessions = Sessions(1, own, connections=False)
    answer = (SessionCheck(CheckKind.ANSWER, 1, digest(own)),)
    assert sessions.on_datagram(hw, SESSION, answer, 0).accepted
    now_ns = 0
    while now_ns < ALIVE_NS + ENDED_NS:  # of another member, in the session that has ended
        now_ns += PERIOD
        assert sessions.on_datagram(hw, SESSION, (), now_ns, is_proven=False, is_judged=True).accepted
    assert sessions.on_datagram(hw, SESSION + 1, answer, now_ns).adopted


def test_beacons_that_are_taken_keep_their_session() -> None:
    own, hw = 5, 9
    sessions = Sessions(1, own, connections=False)
    answer = (SessionCheck(CheckKind.ANSWER, 1, digest(own)),)
    assert sessions.on_datagram(hw, SESSION, answer, 0).accepted
    for step in range(1, 40):
        assert sessions.on_datagram(hw, SESSION, (), step * PERIOD, is_judged=True).accepted
        sessions.on_taken(hw, step * PERIOD)
    sessions.on_taken(hw + 1, 0)  # not known: nothing
    assert not sessions.on_datagram(hw, SESSION + 1, answer, 40 * PERIOD).accepted
