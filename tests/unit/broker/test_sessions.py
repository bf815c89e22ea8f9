"""A node accepts only senders that have answered it, and only sessions with a proof."""

from typing import Final

import pytest

from swarmd.broker.core.beacon.parts.session_checks import CheckKind, SessionCheck
from swarmd.broker.core.membership.sessions import (
    ALIVE_NS,
    CHECKS_MAX,
    CLAIMS_MAX,
    PRESENT_MAX,
    SessionOutcome,
    Sessions,
    digest,
)

MS: Final = 1_000_000
A, B = 1, 2


class Node:
    """One node's sessions; says what waits in each of its datagrams."""

    def __init__(self, hw: int, session: int, *, keys: bool = True) -> None:
        self.hw = hw
        self.session = session
        self.sessions = Sessions(hw, session, connections=keys)

    def say(self, now_ns: int) -> tuple[int, int, tuple[SessionCheck, ...]]:
        return self.hw, self.session, self.sessions.due(now_ns)

    def meets(self) -> bool:
        return self.sessions.meets

    def hear(self, said: tuple[int, int, tuple[SessionCheck, ...]], now_ns: int) -> SessionOutcome:
        return self.sessions.on_datagram(*said, now_ns)


def talk(one: Node, other: Node, start_ns: int, rounds: int = 4, *, prove: bool = True) -> int:
    """Both nodes receive beacons and connections of each other; returns the instant after it."""
    now_ns = start_ns
    for _ in range(rounds):
        for speaker, hearer in ((one, other), (other, one)):
            now_ns += 50 * MS
            if hearer.hear(speaker.say(now_ns), now_ns).prove and prove:
                speaker.sessions.on_proof(hearer.hw, hearer.session, now_ns)
    return now_ns


@pytest.mark.parametrize("keys", [True, False])
def test_two_nodes_accept_each_other_after_answer(keys: bool) -> None:
    one, other = Node(A, 10, keys=keys), Node(B, 20, keys=keys)
    first = other.hear(one.say(0), 0)
    assert (first.accepted, first.soon) == (False, True)
    assert one.hear(other.say(MS), MS).accepted
    assert other.hear(one.say(2 * MS), 2 * MS).accepted
    talk(one, other, 3 * MS)
    assert one.say(SECOND)[2] == other.say(SECOND)[2] == (), "then they say no more about it"


def test_record_of_former_datagrams_is_refused_after_restart() -> None:
    dead, receiver = Node(A, 10), Node(B, 20)
    tape = []
    for step in range(200):
        now_ns = step * 100 * MS
        tape.append(dead.say(now_ns))
        receiver.hear(tape[-1], now_ns)
        dead.hear(receiver.say(now_ns), now_ns)
    assert receiver.sessions.present(A) == 10
    again = Node(B, 21)
    for step, said in enumerate(tape * 20):
        assert not again.hear(said, step * 10 * MS).accepted
        again.say(step * 10 * MS)
    assert again.sessions.present(A) is None


@pytest.mark.parametrize("session", [2**64 - 2, 11, 9, 0])
def test_another_session_is_accepted_only_with_proof(session: int) -> None:
    old, receiver = Node(A, 10), Node(B, 20)
    now_ns = talk(old, receiver, 0)
    said_only = Node(A, session)
    for step in range(100):
        now_ns += 50 * MS
        receiver.hear(said_only.say(now_ns), now_ns)
        said_only.hear(receiver.say(now_ns), now_ns)  # it answers, but has no key to prove itself with
        if step % 2:
            assert receiver.hear(old.say(now_ns), now_ns).accepted
    assert receiver.sessions.present(A) == 10
    restarted = Node(A, session)
    now_ns += 5000 * MS
    talk(restarted, receiver, now_ns)
    assert receiver.sessions.present(A) == session


def test_proven_session_displaces_first_claim() -> None:
    receiver = Node(B, 20)
    liar, owner = Node(A, 2**64 - 2), Node(A, 10)
    now_ns = talk(liar, receiver, 0, prove=False)
    assert receiver.sessions.present(A) == liar.session
    for _ in range(10):
        now_ns += 50 * MS
        receiver.hear(liar.say(now_ns), now_ns)
        if owner.hear(receiver.say(now_ns), now_ns).prove:
            receiver.sessions.on_proof(A, owner.session, now_ns)
        receiver.hear(owner.say(now_ns), now_ns)
    assert receiver.sessions.present(A) == owner.session


@pytest.mark.parametrize("keys", [True, False])
def test_one_of_two_namesakes_is_accepted(keys: bool) -> None:
    receiver = Node(B, 20, keys=keys)
    one, copy = Node(A, 10, keys=keys), Node(A, 30, keys=keys)
    now_ns = talk(one, receiver, 0)
    changes, duplicates, before = 0, 0, receiver.sessions.present(A)
    told = set()
    for _ in range(200):
        now_ns += 50 * MS
        asked = receiver.say(now_ns)
        for node, other in ((one, copy), (copy, one)):
            if node.hear(asked, now_ns).prove:
                receiver.sessions.on_proof(A, node.session, now_ns)
            said = node.say(now_ns)
            duplicates += receiver.hear(said, now_ns).duplicate
            if other.hear(said, now_ns).duplicate:
                told.add(other.session)
        changes += receiver.sessions.present(A) != before
        before = receiver.sessions.present(A)
    assert changes <= 1
    assert duplicates > 10
    assert told == {10, 30}, "both hear that there are two"
    stays = one if before == copy.session else copy
    left_ns = now_ns
    while receiver.sessions.present(A) != stays.session:
        now_ns += 50 * MS
        if stays.hear(receiver.say(now_ns), now_ns).prove:
            receiver.sessions.on_proof(A, stays.session, now_ns)
        receiver.hear(stays.say(now_ns), now_ns)
        assert now_ns - left_ns < 2 * ALIVE_NS


def test_record_of_own_former_session_is_harmless() -> None:
    before, receiver = Node(A, 9), Node(B, 20)
    talk(before, receiver, 0)
    now = Node(A, 10)
    for step in range(50):
        assert not now.hear((A, 9, (SessionCheck(CheckKind.ANSWER, A, digest(9)),)), step * MS).duplicate


def test_only_what_names_our_present_session_is_answer() -> None:
    node = Node(A, 10)
    for check in (
        SessionCheck(CheckKind.ANSWER, A, digest(9)),
        SessionCheck(CheckKind.ANSWER, B, digest(10)),
        SessionCheck(CheckKind.QUESTION, A, digest(10)),
        SessionCheck(99, A, digest(10)),
    ):
        assert not node.hear((B, 20, (check,)), 0).accepted
    assert node.hear((B, 20, (SessionCheck(CheckKind.ANSWER, A, digest(10)),)), 0).accepted


def test_flood_of_sessions_is_bounded() -> None:
    node = Node(A, 10)
    answer = (SessionCheck(CheckKind.QUESTION, A, digest(10)),)
    for number in range(3 * CLAIMS_MAX):
        node.hear((100 + number, 1 + number, answer), number * MS)
    assert len(node.sessions._claims) <= CLAIMS_MAX
    assert len(node.say(SECOND)[2]) == CHECKS_MAX
    assert node.sessions.waiting == CHECKS_MAX
    accepted = (SessionCheck(CheckKind.ANSWER, A, digest(10)),)
    for number in range(PRESENT_MAX + 10):
        node.hear((10_000 + number, 1, accepted), 2 * SECOND + number)
    assert len(node.sessions._present) == PRESENT_MAX


def test_one_session_is_asked_at_its_pace() -> None:
    node = Node(A, 10)
    hurried = sum(node.hear((B, 20, ()), step * MS).soon for step in range(0, 10_000, 5))
    assert hurried == 3


SECOND: Final = 1000 * MS


def test_session_over_line_follows_with_higher_number() -> None:
    receiver = Sessions(B, 20, connections=True)
    answer = (SessionCheck(CheckKind.ANSWER, B, digest(20)),)

    def hear(session: int, now_ns: int, *, by_network: bool = False) -> SessionOutcome:
        return receiver.on_datagram(A, session, answer, now_ns, by_network=by_network)

    assert hear(10, 0).accepted
    assert not hear(11, 100 * MS).accepted, "the former one was just received"
    assert hear(11, 100 * MS + ALIVE_NS).adopted
    assert not hear(10, 10 * SECOND).accepted, "a record of the former session is no successor"
    assert not hear(12, 20 * SECOND, by_network=True).accepted, "where it can connect it must prove itself"
    receiver.on_proof(A, 12, 20 * SECOND)
    assert hear(12, 30 * SECOND, by_network=True).accepted


def test_node_offers_itself_to_new_sessions_only() -> None:
    one, other = Node(A, 7), Node(B, 8)
    other.hear(one.say(0), 0)
    assert other.meets(), "it answers before it is asked"
    answer = other.say(MS)
    assert not other.meets()
    one.hear(answer, 2 * MS)
    assert one.meets()
    other.hear(one.say(3 * MS), 3 * MS)
    other.say(4 * MS)
    again = SessionCheck(CheckKind.QUESTION, B, digest(8))
    assert other.hear((A, 7, (again,)), 5 * MS).soon
    assert other.sessions.waiting
    assert not other.meets()


def test_own_session_is_proven_to_restarted_neighbour() -> None:
    sessions = Sessions(B, 20, connections=True)
    answer, prove = (SessionCheck(kind, B, digest(20)) for kind in (CheckKind.ANSWER, CheckKind.PROVE))
    assert sessions.on_datagram(A, 10, (answer, prove), 0).prove
    assert not sessions.on_datagram(A, 10, (prove,), 100 * MS).prove, "a moment ago"
    assert not sessions.on_datagram(A, 11, (answer, prove), 150 * MS).accepted
    sessions.on_proof(A, 11, 160 * MS)
    assert sessions.on_datagram(A, 11, (prove,), 200 * MS).prove, "the new session has no proof yet"
