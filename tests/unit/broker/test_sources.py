"""Which beacons are taken: those that their sender signs, and others while nothing speaks against them."""

import msgspec
import pytest
from tests.unit.broker.pair import FALSE, PERIOD, Pair, Receiver
from tests.unit.broker.signed_beacons import HOST, SESSION, Member

from swarmd.broker.core.admission.sources import (
    ASK_AGAIN_NS,
    BURST,
    GUARD_NS,
    JUMP,
    RENEWAL_NS,
    TRUST_NS,
    Verdict,
)
from swarmd.broker.core.beacon.beacon import Beacon, Header
from swarmd.broker.core.beacon.session_checks import CheckKind
from swarmware.model.names import hardware_id


def test_true_beacons_are_taken_with_any_loss() -> None:
    pair = Pair()
    for step in range(600):
        lost = step % 7 in (1, 2, 3)
        verdict = pair.true(lost=lost)
        assert not verdict.is_evidence
        assert verdict.is_taken or lost
        if verdict.ask is CheckKind.QUESTION:
            pair.victim.signatures.reserved_bytes(pair.now_ns, must_sign=True)


def test_before_a_signature_no_beacon_is_taken_and_its_sender_is_asked() -> None:
    receiver, victim = Receiver(), Member("uav1")
    verdict = receiver.take(victim.beacon(5, 0, signed=False), 0)
    assert verdict == Verdict(is_taken=False, refusal="unproven", ask=CheckKind.QUESTION)
    again = receiver.take(victim.beacon(6, PERIOD, signed=False), PERIOD)
    assert again is not None
    assert again.ask is None, "asked just now"
    later = receiver.take(victim.beacon(7, ASK_AGAIN_NS, signed=False), ASK_AGAIN_NS)
    assert later is not None
    assert later.ask is CheckKind.QUESTION
    assert receiver.take(victim.beacon(8, PERIOD, signed=True), PERIOD) == Verdict(is_taken=True)
    assert receiver.take(victim.beacon(9, PERIOD, signed=False), PERIOD) == Verdict(is_taken=True)


def test_trust_in_a_signature_ends_and_its_sender_is_asked_before() -> None:
    pair = Pair()
    asked, last = None, -1
    for step in range(1, 140):
        verdict = pair.true(signed=False)
        if verdict.ask is not None and asked is None:
            asked = step
        if verdict.is_taken:
            last = step
    assert asked is not None
    first = 19  # steps since the signed beacon
    assert (asked + first) * PERIOD > RENEWAL_NS >= (asked + first - 1) * PERIOD
    assert (last + first) * PERIOD <= TRUST_NS < (last + first + 1) * PERIOD
    assert pair.true(signed=True).is_taken
    assert pair.true().is_taken


def test_a_false_beacon_is_found_by_the_true_one_with_its_number() -> None:
    pair = Pair()
    assert pair.false(pair.sequence + 1).is_taken, "the first one cannot be known"
    verdict = pair.true()
    assert not verdict.is_taken
    assert verdict.is_evidence
    assert verdict.ask is CheckKind.SIGN
    assert verdict.suspects == ("10.0.0.9",)
    for step in range(50):
        assert pair.false(pair.sequence + 1 + step).refusal == "unsigned"
    taken = pair.true(signed=True)
    assert taken.is_taken
    assert taken.continues_at == pair.sequence


def test_after_evidence_nothing_unsigned_is_taken_for_a_minute() -> None:
    pair = Pair()
    pair.false(pair.sequence + 1)
    assert pair.true().is_evidence
    began_ns = pair.now_ns
    pair.victim.signatures.sign_all(pair.now_ns)
    while pair.now_ns < began_ns + GUARD_NS - PERIOD:
        assert pair.true().is_taken
        false = pair.false(pair.sequence + 1)
        assert (false.is_taken, false.refusal) == (False, "unsigned")


def test_who_signs_all_is_asked_to_continue_when_false_ones_still_arrive() -> None:
    pair = Pair()
    pair.victim.signatures.sign_all(pair.now_ns)
    asked_ns = 0
    for _ in range(590):
        pair.true()
        if pair.false(pair.sequence + 1).ask is CheckKind.SIGN and not asked_ns:
            asked_ns = pair.now_ns
    assert asked_ns > 30_000_000_000


def test_a_statement_of_the_sender_is_enough_for_receivers_that_have_no_evidence() -> None:
    pair = Pair()
    pair.victim.signatures.sign_all(pair.now_ns)
    assert pair.true().is_taken
    assert pair.false(pair.sequence + 1).refusal == "unsigned"
    for _ in range(660):
        assert pair.true().is_taken, "it signs all for longer than it states, so none of its own is refused"


def test_numbers_that_were_pushed_ahead_do_not_block_the_true_ones() -> None:
    pair = Pair()
    pushed = [pair.false(pair.sequence + ahead) for ahead in range(60, 180, 10)]
    assert any(verdict.is_taken for verdict in pushed)
    refused = pair.true()
    assert not refused.is_taken
    assert CheckKind.QUESTION in {verdict.ask for verdict in (*pushed, refused)}
    verdict = pair.true(signed=True)
    assert verdict.is_taken
    assert verdict.is_evidence
    assert verdict.continues_at == pair.sequence
    assert verdict.suspects == ("10.0.0.9",)
    assert pair.true(signed=True).is_taken


@pytest.mark.parametrize("ahead", [1000, 5000, 1 << 31])
def test_a_number_far_ahead_is_taken_only_with_a_signature(ahead: int) -> None:
    pair = Pair()
    for step in range(1000):
        assert pair.false(pair.sequence + ahead + step).refusal == "unproven"
    assert pair.true().is_taken
    pair.sequence += ahead
    assert pair.true(signed=False).refusal == "unproven"
    raised = pair.true(signed=True)
    assert raised.is_taken
    assert not raised.is_evidence
    assert raised.continues_at == pair.sequence
    assert pair.true().is_taken


def test_a_false_beacon_in_place_of_a_lost_one_is_found_by_the_next_signature() -> None:
    pair = Pair(steps=38)
    pair.true(lost=True)
    assert pair.false(pair.sequence).is_taken
    found = [pair.true() for _ in range(45)]
    signed = [verdict for verdict in found if verdict.is_evidence]
    assert len(signed) == 1
    assert signed[0].is_taken
    assert signed[0].ask is CheckKind.SIGN
    assert signed[0].suspects == ("10.0.0.9",)


def test_a_false_signature_is_evidence() -> None:
    pair = Pair()
    verdict = pair.false(pair.sequence + 1, signed=True)
    assert (verdict.is_taken, verdict.is_evidence, verdict.refusal) == (False, True, "unsigned")


@pytest.mark.parametrize("what", ["session", "clear header", "body", "sender"])
def test_a_signature_holds_for_its_beacon_only(what: str) -> None:
    sent, receiver = Member("uav1").beacon(5, 0, signed=True), Receiver()
    header, beacon, datagram = sent.header, sent.beacon, sent.datagram
    assert receiver.sources.is_signed(header, beacon, datagram)
    if what == "session":
        header = msgspec.structs.replace(header, session=SESSION + 1)
    elif what == "clear header":
        datagram = msgspec.structs.replace(datagram, clear=datagram.clear[:-1] + b"?")
    elif what == "body":
        datagram = msgspec.structs.replace(datagram, body=b"?" + datagram.body[1:])
    else:
        header = msgspec.structs.replace(header, sender_hw=hardware_id("uav3"))
    assert receiver.sources.is_signed(header, beacon, datagram) is False


def test_a_recorded_signed_beacon_is_not_taken_again() -> None:
    pair = Pair()
    recorded = pair.victim.beacon(90, 0, signed=True)
    late = pair.receiver.take(recorded, pair.now_ns)
    assert late is not None
    assert late.is_taken, "overtaken on its way"
    assert pair.receiver.take(recorded, pair.now_ns) is None


def test_no_more_unsigned_beacons_are_taken_at_once_than_a_delay_can_collect() -> None:
    pair = Pair()
    pair.now_ns += PERIOD
    taken = [pair.false(pair.sequence + 1 + step).is_taken for step in range(60)]
    assert sum(taken) == BURST
    assert JUMP >= 60, "not for their numbers"


def test_a_new_session_of_the_sender_begins_anew() -> None:
    pair = Pair()
    restarted = Member("uav1", session=SESSION + 1)
    assert pair.receiver.take(restarted.beacon(500, pair.now_ns, signed=False), pair.now_ns) == Verdict(
        is_taken=False, refusal="unproven", ask=CheckKind.QUESTION
    )
    first = pair.receiver.take(restarted.beacon(501, pair.now_ns, signed=True), pair.now_ns)
    assert first is not None
    assert first.is_taken
    assert not first.is_evidence


def test_who_is_not_a_member_signs_nothing() -> None:
    sent = Member("uav9").beacon(5, 0, signed=True)
    assert Receiver().sources.is_signed(sent.header, sent.beacon, sent.datagram) is None, "no key to compare"


def test_a_removed_member_is_forgotten() -> None:
    pair = Pair()
    pair.receiver.sources.forget(pair.victim.hw)
    assert pair.true(signed=False).refusal == "unproven"


def test_a_beacon_without_a_signature_proves_nothing_and_contradicts_nothing() -> None:
    sent = Member("uav1", host=HOST).beacon(5, 0, signed=False)
    header = Header(0, sent.header.sender_hw, 5, 0)
    assert Receiver().sources.is_signed(header, Beacon(), sent.datagram) is None


def test_a_signed_beacon_that_a_slow_medium_brings_late_contradicts_nothing() -> None:
    pair = Pair()
    pair.sequence += 1
    late = pair.victim.beacon(pair.sequence, pair.now_ns, signed=True)  # lost on the first medium
    for _ in range(10):
        pair.true(signed=False)
    slow = msgspec.structs.replace(late, datagram=msgspec.structs.replace(late.datagram, medium=1))
    sources = pair.receiver.sources
    verdict = sources.judge(slow.header, slow.beacon, slow.datagram, True, pair.now_ns)
    assert verdict.is_taken
    assert not verdict.is_evidence
    again = sources.judge(late.header, late.beacon, late.datagram, True, pair.now_ns)
    assert not again.is_evidence


def test_a_false_beacon_over_another_medium_is_found_by_the_true_one() -> None:
    pair = Pair()
    false = pair.forger.beacon(pair.sequence + 1, pair.now_ns, signed=False, content=FALSE)
    datagram = msgspec.structs.replace(false.datagram, medium=1)
    assert pair.receiver.sources.judge(false.header, false.beacon, datagram, None, pair.now_ns).is_taken
    assert pair.true().is_evidence
