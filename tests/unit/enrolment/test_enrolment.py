"""Joining by messages: who is admitted, once per token, and every refusal with its reason."""

from itertools import count

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import Denied, InvalidInput, NotFound, SwarmError, WireError
from swarmware.transport.enrolment.inviter import (
    ADDRESSES_MAX,
    ATTEMPTS,
    ATTEMPTS_OF_ALL,
    RECEIPT_NS,
    SECOND_NS,
    Admission,
    Invitation,
    Inviter,
)
from swarmware.transport.enrolment.joiner import UNSIGNED, Credentials, Joiner, from_file
from swarmware.transport.enrolment.messages import (
    REQUEST_MAX,
    JoinAnswer,
    JoinFile,
    JoinRefusal,
    JoinRequest,
    open_answer,
    refuse,
    seal_answer,
    seal_file,
    seal_request,
)
from swarmware.transport.enrolment.token import JoinToken, root_digest
from swarmware.transport.sodium import SealKey, SigningKey

ROOT = SigningKey(bytes(32)).public
MINUTE_NS = 60 * SECOND_NS
UTC_NS = 1_790_000_000 * SECOND_NS
NONCE = bytes(12)
SEED, OTHER_SEED = b"1" * 32, b"2" * 32


def token(secret: int = 1) -> JoinToken:
    return JoinToken(bytes([secret]) * 16, root_digest(ROOT), UTC_NS // SECOND_NS + 600, ("10.0.0.1",), 7449)


def inviter(*platforms: str, **former: JoinRefusal) -> Inviter:
    invitations = [
        Invitation(platform, "node", token(secret), 10 * MINUTE_NS)
        for secret, platform in enumerate(platforms or ("uav1",), 1)
    ]
    nonces = count()
    numbers = {token(int(secret[1:])).number: why for secret, why in former.items()}
    return Inviter(invitations, numbers, lambda: next(nonces).to_bytes(12, "big"), 0)


def ask(core: Inviter, joiner: Joiner, now_ns: int = 1) -> Admission | bytes | None:
    return core.on_request(joiner.request(NONCE), UTC_NS, now_ns)


def admit(core: Inviter, joiner: Joiner, now_ns: int = 1) -> bytes:
    admission = ask(core, joiner, now_ns)
    assert isinstance(admission, Admission)
    return core.admitted(admission, ROOT, b"roster", UTC_NS, now_ns)


def test_node_with_token_is_admitted_and_gets_roster() -> None:
    core, joiner = inviter(), Joiner(token(), "uav1", SEED)
    admission = ask(core, joiner)
    assert isinstance(admission, Admission)
    assert admission.invitation.platform == "uav1" and not admission.repeated
    assert admission.request.sign_public == SigningKey(SEED).public
    assert [one.platform for one in core.pending] == ["uav1"], "not used before the root has signed"
    answer = core.admitted(admission, ROOT, b"roster", UTC_NS, 1, 7450)
    assert joiner.on_answer(answer, UTC_NS + 12 * SECOND_NS) == Credentials(SEED, ROOT, b"roster", 12.0, 7450)
    assert core.pending == ()


def test_lost_answer_is_repeated_to_same_key() -> None:
    core, joiner = inviter(), Joiner(token(), "uav1", SEED)
    admit(core, joiner)
    again = ask(core, joiner)
    assert isinstance(again, Admission) and again.repeated
    refused = ask(core, Joiner(token(), "uav1", OTHER_SEED))
    assert isinstance(refused, bytes)
    with pytest.raises(Denied, match=r"the token was used.*swarmctl keys invite uav1"):
        Joiner(token(), "uav1", OTHER_SEED).on_answer(refused, UTC_NS)


def test_token_expires_by_clock_of_inviter() -> None:
    core, joiner = inviter("uav1", "uav2"), Joiner(token(), "uav1", SEED)
    assert core.deadline_ns() == 10 * MINUTE_NS
    assert core.expire(10 * MINUTE_NS - 1) == ()
    assert [one.platform for one in core.expire(10 * MINUTE_NS)] == ["uav1", "uav2"]
    assert core.expire(10 * MINUTE_NS) == () and core.deadline_ns() is None
    refused = ask(core, joiner, 10 * MINUTE_NS)
    assert isinstance(refused, bytes)
    with pytest.raises(Denied, match=r"the token has expired: .*inviter's clock"):
        joiner.on_answer(refused, 0)


def test_clock_of_node_does_not_matter_over_air() -> None:
    core, joiner = inviter(), Joiner(token(), "uav1", SEED)
    found = joiner.on_answer(admit(core, joiner), 0)
    assert isinstance(found, Credentials) and found.ahead_s == -UTC_NS / SECOND_NS


@pytest.mark.parametrize(
    ("why", "error", "text"),
    [
        (JoinRefusal.USED, Denied, "the token was used"),
        (JoinRefusal.EXPIRED, Denied, "the token has expired"),
    ],
)
def test_earlier_invitations_token_is_refused_with_reason(
    why: JoinRefusal, error: type[SwarmError], text: str
) -> None:
    core, joiner = inviter("uav1", s9=why), Joiner(token(9), "uav1", SEED)
    refused = ask(core, joiner)
    assert isinstance(refused, bytes)
    found = joiner.on_answer(refused, UTC_NS)
    assert isinstance(found, error) and text in str(found)


def test_an_unknown_token_is_refused_as_unknown() -> None:
    joiner = Joiner(token(9), "uav1", SEED)
    refused = ask(inviter(), joiner)
    assert isinstance(refused, bytes)
    found = joiner.on_answer(refused, UTC_NS)
    assert isinstance(found, NotFound) and "does not know this token (unsigned: any computer" in str(found)


def test_node_of_another_name_leaves_token_valid() -> None:
    core, joiner = inviter(), Joiner(token(), "uav2", SEED)
    refused = ask(core, joiner)
    assert isinstance(refused, bytes)
    with pytest.raises(InvalidInput, match=r"for uav1; `platform` of node.toml is uav2"):
        joiner.on_answer(refused, UTC_NS)
    assert isinstance(ask(core, Joiner(token(), "uav1", SEED)), Admission)


def test_key_that_node_does_not_hold_is_refused() -> None:
    proof = SigningKey(OTHER_SEED).sign(b"anything")
    request = JoinRequest("uav1", SigningKey(SEED).public, proof)
    core = inviter()
    refused = core.on_request(seal_request(token(), NONCE, request), UTC_NS, 1)
    assert isinstance(refused, bytes)
    found = open_answer(token(), refused)
    assert isinstance(found, JoinAnswer) and found.refusal == JoinRefusal.PROOF
    assert len(core.pending) == 1


def test_root_that_cannot_sign_leaves_token_valid() -> None:
    core, joiner = inviter(), Joiner(token(), "uav1", SEED)
    admission = ask(core, joiner)
    assert isinstance(admission, Admission)
    with pytest.raises(SwarmError, match="could not sign the roster: the stick was removed"):
        joiner.on_answer(core.failed(admission, "the stick was removed", UTC_NS), UTC_NS)
    assert isinstance(ask(core, joiner), Admission)


def test_an_answer_of_another_root_is_refused() -> None:
    other = SigningKey(b"3" * 32).public
    answer = seal_answer(token(), NONCE, JoinAnswer(UTC_NS, root_public=other, roster=b"roster"))
    with pytest.raises(Denied, match="not the one of the token"):
        Joiner(token(), "uav1", SEED).on_answer(answer, UTC_NS)


def test_unknown_refusal_is_error_with_its_text() -> None:
    joiner = Joiner(token(), "uav1", SEED)
    with pytest.raises(Denied, match="uav1: no room"):
        joiner.on_answer(seal_answer(token(), NONCE, JoinAnswer(UTC_NS, 99, "no room")), UTC_NS)
    with pytest.raises(WireError, match="refusal 99"):
        joiner.on_answer(b"SWR1\x63", UTC_NS)
    assert "too many requests" in str(joiner.on_answer(refuse(JoinRefusal.BUSY), UTC_NS))


@pytest.mark.parametrize("why", JoinRefusal)
def test_clear_text_refusal_lets_other_addresses_answer(why: JoinRefusal) -> None:
    found = Joiner(token(), "uav1", SEED).on_answer(refuse(why), UTC_NS)
    assert isinstance(found, SwarmError) and f"({UNSIGNED})" in str(found)


def receipt(secret: int = 1) -> bytes:
    return Joiner(token(secret), "uav1", SEED).receipt(NONCE)


def test_inviter_waits_for_receipt_of_each_node() -> None:
    core = inviter("uav1", "uav2")
    for secret, platform in ((1, "uav1"), (2, "uav2")):
        admit(core, Joiner(token(secret), platform, SEED), 5 * SECOND_NS)
    assert core.pending == () and core.deadline_ns() == 5 * SECOND_NS + RECEIPT_NS
    assert core.on_receipt(receipt(3)) is None, "of another invitation"
    for secret, platform in ((1, "uav1"), (2, "uav2")):
        found = core.on_receipt(receipt(secret))
        assert found is not None and found.platform == platform
        assert core.on_receipt(receipt(secret)) is None, "once"
    assert core.deadline_ns() is None
    assert core.expire_receipts(MINUTE_NS) == ()


def test_receipt_wait_restarts_with_each_answer() -> None:
    core, joiner = inviter(), Joiner(token(), "uav1", SEED)
    admit(core, joiner, SECOND_NS)
    admit(core, joiner, 20 * SECOND_NS)
    assert core.expire_receipts(SECOND_NS + RECEIPT_NS) == ()
    over = 20 * SECOND_NS + RECEIPT_NS
    assert core.deadline_ns() == over
    assert [one.platform for one in core.expire_receipts(over)] == ["uav1"]
    assert core.deadline_ns() is None and core.on_receipt(receipt()) is None


def test_lost_answer_is_repeated_after_token_expired() -> None:
    core, joiner = inviter(), Joiner(token(), "uav1", SEED)
    admit(core, joiner, 10 * MINUTE_NS - 1)
    again = ask(core, joiner, 10 * MINUTE_NS + 1)
    assert isinstance(again, Admission) and again.repeated


@given(st.binary(max_size=300), st.integers(0, 60), st.integers(1, 255))
def test_a_false_or_changed_receipt_is_none(data: bytes, place: int, change: int) -> None:
    core = inviter()
    admit(core, Joiner(token(), "uav1", SEED))
    changed = bytearray(receipt())
    changed[place % len(changed)] ^= change
    assert core.on_receipt(data) is None
    assert core.on_receipt(bytes(changed)) is None
    assert core.on_receipt(receipt()) is not None


def test_one_address_cannot_keep_the_others_out() -> None:
    core = inviter()
    taken = [core.on_connection("10.0.0.9", 1) for _ in range(3 * ATTEMPTS)]
    assert taken == [True] * ATTEMPTS + [False] * (2 * ATTEMPTS)
    assert core.limited == 2 * ATTEMPTS
    assert core.on_connection("10.0.0.2", 1)
    assert core.on_connection("10.0.0.9", SECOND_NS + 1), "one more after a second"
    assert not core.on_connection("10.0.0.9", SECOND_NS + 1)


def test_addresses_are_limited_and_their_table_bounded() -> None:
    core = inviter()
    taken = [core.on_connection(f"10.0.{n >> 8}.{n & 255}", 1) for n in range(3 * ADDRESSES_MAX)]
    assert sum(taken) == ATTEMPTS_OF_ALL
    assert core.on_connection("10.9.9.9", SECOND_NS + 1)


@given(st.binary(max_size=2 * REQUEST_MAX))
def test_garbage_is_counted_and_gets_no_answer(data: bytes) -> None:
    core = inviter()
    assert core.on_request(data, UTC_NS, 1) is None
    assert core.garbage == 1 and len(core.pending) == 1


@given(st.binary(max_size=400))
def test_garbage_behind_a_known_number_is_counted(data: bytes) -> None:
    core = inviter()
    assert core.on_request(b"SWJ1" + token().number + NONCE + data, UTC_NS, 1) is None
    assert core.garbage == 1


@given(st.integers(0, 10_000), st.integers(1, 255))
def test_a_changed_request_is_never_admitted(place: int, change: int) -> None:
    data = bytearray(Joiner(token(), "uav1", SEED).request(NONCE))
    data[place % len(data)] ^= change
    assert not isinstance(inviter().on_request(bytes(data), UTC_NS, 1), Admission)


SEALED: list[object] = [None, 7, "uav1", [], ["uav1"], ["uav1", b"", b""], ["uav1", b"x" * 31, b""], [1, 2]]


@pytest.mark.parametrize("content", SEALED, ids=str)
def test_a_sealed_request_of_another_form_is_garbage(content: object) -> None:
    clear = b"SWJ1" + token().number
    box = SealKey(token().key(b"SWJ1")).seal(NONCE, msgspec.msgpack.encode(content), clear)
    core = inviter()
    assert core.on_request(clear + NONCE + box, UTC_NS, 1) is None
    assert core.garbage == 1


@given(st.binary(max_size=400))
def test_node_refuses_answer_that_is_not_of_inviter(data: bytes) -> None:
    with pytest.raises(WireError):
        Joiner(token(), "uav1", SEED).on_answer(data, UTC_NS)


def file_of(platform: str, root: bytes = ROOT) -> bytes:
    return seal_file(token(), NONCE, JoinFile(platform, SEED, root, b"roster"))


def test_credentials_in_file_are_opened_with_token() -> None:
    found = from_file(token(), "uav1", file_of("uav1"), "uav1.join", UTC_NS // SECOND_NS)
    assert found == Credentials(SEED, ROOT, b"roster")


@pytest.mark.parametrize(
    ("made", "utc_s", "error", "text"),
    [
        (file_of("uav1"), UTC_NS // SECOND_NS + 607, Denied, "expired 7 s ago by this computer's clock"),
        (file_of("uav2"), 0, InvalidInput, "credentials of uav2; `platform` of node.toml is uav1"),
        (file_of("uav1", SigningKey(b"4" * 32).public), 0, Denied, "not the one of the token"),
        (file_of("uav1")[:-1], 0, Denied, "changed on its way"),
        (b"", 0, Denied, "of another token, or damaged"),
        (seal_file(token(2), NONCE, JoinFile("uav1", SEED, ROOT, b"")), 0, Denied, "of one invitation"),
    ],
)
def test_unusable_file_is_refused_with_reason(
    made: bytes, utc_s: int, error: type[SwarmError], text: str
) -> None:
    with pytest.raises(error, match=f"uav1.join.*{text}|{text}"):
        from_file(token(), "uav1", made, "uav1.join", utc_s)


@pytest.mark.parametrize("place", [-1, -17, 13, 25])
def test_message_changed_on_its_way_is_refused(place: int) -> None:
    data = bytearray(seal_answer(token(), NONCE, JoinAnswer(UTC_NS, root_public=ROOT)))
    data[place] ^= 1
    with pytest.raises(WireError, match="not sealed with this token, or changed"):
        open_answer(token(), bytes(data))


def test_request_that_is_too_long_gets_no_answer() -> None:
    one = inviter("uav1")
    short = b"SWJ1" + bytes(REQUEST_MAX - 4)
    assert one.on_request(short, UTC_NS, 0) == refuse(JoinRefusal.UNKNOWN)
    assert one.on_request(short + b"x", UTC_NS, 0) is None
    assert one.garbage == 1
