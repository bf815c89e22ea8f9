"""Which beacons are taken: those that their senders signed, each once; what a signature has in a beacon."""

from typing import Final

import pytest
from tests.unit.broker.signed_beacons import SESSION, Member, SealedBeacon, checks_of

from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Beacon, Header, RouteRow
from swarmd.broker.core.beacon.parts import beacon_signature
from swarmd.broker.core.beacon.parts.beacon_signature import PART_BYTES
from swarmd.broker.core.beacon.parts.session_checks import CheckKind, SessionCheck
from swarmd.broker.core.membership.sessions import ALIVE_NS, ENDED_NS, Sessions, digest
from swarmd.broker.core.membership.signatures import signature_checks
from swarmd.broker.core.membership.signatures.signature_checks import SignatureFault
from swarmware.errors import WireError
from swarmware.model.names import hardware_id
from swarmware.transport.sodium import verify

PERIOD: Final = 100_000_000
TRIES: Final = 1000


def fault(sent: SealedBeacon) -> SignatureFault | None:
    return sent.checked(checks_of("uav2")).fault


def test_signed_beacon_is_genuine_and_proves_values() -> None:
    checked = Member("uav1").beacon(5, PERIOD, b"one", b"two").checked(checks_of("uav2"))
    assert checked.is_genuine
    assert checked.proof is not None
    assert (checked.proof.count, checked.proof.session) == (2, SESSION)


@pytest.mark.parametrize("is_signed", [True, False])
def test_none_of_a_thousand_false_beacons_is_genuine(is_signed: bool) -> None:
    forger, checks = Member("uav1", key="uav3", host="10.0.0.9"), checks_of("uav2")
    for number in range(TRIES):
        checked = forger.beacon(number, number * PERIOD, b"false", is_signed=is_signed).checked(checks)
        assert (checked.fault, checked.host) == (SignatureFault.FALSE, "10.0.0.9")


@pytest.mark.parametrize("what", ["session", "clear header", "body", "sender", "time"])
def test_a_signature_holds_for_its_beacon_only(what: str) -> None:
    sent = Member("uav1").beacon(5, 0, b"value")
    assert fault(sent) is None
    header, clear, body = sent.header, sent.clear, sent.body
    if what == "session":
        header.session = SESSION + 1
    elif what == "clear header":
        clear = clear[:-1] + b"?"
    elif what == "body":
        body = b"?" + body[1:]
    elif what == "time":
        header.tx_us += 1
    else:
        header.sender_hw = hardware_id("uav3")
    assert fault(sent._replace(clear=clear, body=body)) is SignatureFault.FALSE


def test_sender_without_key_is_unknown_until_hello() -> None:
    stranger = Member("uav9")
    assert fault(stranger.beacon(5, 0)) is SignatureFault.UNKNOWN
    assert fault(stranger.beacon(5, 0, hello=stranger.hello())) is SignatureFault.UNKNOWN, "on no roster"
    unit = Member("uav1.fc", key="uav1")
    unit.hw = hardware_id("uav1", "fc")
    unit.signatures._own_hw = unit.hw
    assert fault(unit.beacon(5, 0)) is SignatureFault.UNKNOWN
    assert fault(unit.beacon(6, 0, hello=unit.hello())) is None
    assert fault(unit.beacon(6, 0, hello=unit.hello(), is_signed=False)) is SignatureFault.FALSE


@pytest.mark.parametrize(("has_copies", "count"), [(True, 1), (False, 2)])
def test_copy_from_another_medium_is_verified_once(
    monkeypatch: pytest.MonkeyPatch, has_copies: bool, count: int
) -> None:
    verified: list[bytes] = []

    def counting(public: bytes, signature: bytes, data: bytes) -> bool:
        verified.append(signature)
        return verify(public, signature, data)

    monkeypatch.setattr(signature_checks, "verify", counting)
    sent, checks = Member("uav1").beacon(5, 0, b"value"), checks_of("uav2", has_copies=has_copies)
    assert all(sent.checked(checks).is_genuine for _ in range(2))
    assert len(verified) == count
    changed = sent._replace(body=sent.body[:-65] + b"?" + sent.body[-64:])
    assert changed.checked(checks).fault is SignatureFault.FALSE


def test_signature_has_stated_size_and_changes_nothing() -> None:
    bare = codec.encode(Beacon(rows=(RouteRow(9, 1, 256),)))
    body = Member("uav1").signatures.signed(b"clear", bare, (), 0x1234_0000_0005)
    assert len(body) == len(bare) + PART_BYTES
    found = codec.decode(body)
    assert found.signature is not None
    assert found.rows == (RouteRow(9, 1, 256),)
    assert (found.signature.signed_bytes, found.signature.clock_high) == (len(body) - 64, 0x1234)


@pytest.mark.parametrize("length", [0, 5, 65, 67])
def test_signature_of_invalid_length_is_not_body(length: int) -> None:
    part = bytes((beacon_signature.SIGNATURE,)) + length.to_bytes(2, "little") + bytes(length)
    with pytest.raises(WireError, match="signature is not its last part"):
        codec.decode(codec.append_statement(codec.encode(Beacon()), part))


def test_part_behind_signature_makes_body_invalid() -> None:
    body = Member("uav1").signatures.signed(b"clear", codec.encode(Beacon()), (), 0)
    with pytest.raises(WireError, match="signature is not its last part"):
        codec.decode(codec.append_statement(body, bytes((99, 0, 0))))


def test_beacon_of_unknown_session_has_no_valid_signature() -> None:
    sent = Member("uav1").beacon(5, 0)
    assert fault(sent._replace(header=Header(0, sent.header.sender_hw, 5, 0))) is SignatureFault.FALSE


def test_beacons_without_key_do_not_keep_session() -> None:
    own, hw = 5, 9
    sessions = Sessions(1, own, connections=False)
    answer = (SessionCheck(CheckKind.ANSWER, 1, digest(own)),)
    assert sessions.on_datagram(hw, SESSION, answer, 0).accepted
    now_ns = 0
    while now_ns < ALIVE_NS + ENDED_NS:  # of another member, in the session that has ended
        now_ns += PERIOD
        assert sessions.on_datagram(hw, SESSION, (), now_ns, is_proven=False).accepted
    assert sessions.on_datagram(hw, SESSION + 1, answer, now_ns).adopted


def test_genuine_beacons_keep_their_session() -> None:
    own, hw = 5, 9
    sessions = Sessions(1, own, connections=False)
    answer = (SessionCheck(CheckKind.ANSWER, 1, digest(own)),)
    assert sessions.on_datagram(hw, SESSION, answer, 0).accepted
    for step in range(1, 40):
        assert sessions.on_datagram(hw, SESSION, (), step * PERIOD).accepted
    assert not sessions.on_datagram(hw, SESSION + 1, answer, 40 * PERIOD).accepted
