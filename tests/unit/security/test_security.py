"""Keys, rosters and sealed datagrams: what is let in and what is not."""

import stat
from pathlib import Path

import pytest
import zmq
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from hypothesis import given
from hypothesis import strategies as st
from zmq.utils import z85

from swarmware.errors import ConfigError, Denied, InvalidInput
from swarmware.transport.security.keys import Keys, read_roster
from swarmware.transport.security.root import make_swarm
from swarmware.transport.security.roster import Roster, RosterMember, sign_roster
from swarmware.transport.security.seal import REPLAY_WINDOW, GroupKey, Opened, Opener, Refusal, Sealer
from swarmware.transport.sodium import SigningKey

GROUP = GroupKey(3, bytes(range(32)))
HW = 0xCAFE
OTHER_SEED = b"\5" * 32
CLEAR = b"the clear header"


def sealed(sequence: int, *, session: int = 1, group: GroupKey = GROUP, body: bytes = b"body") -> bytes:
    return Sealer(group, HW, session).seal(sequence, CLEAR, body)


def opened(
    opener: Opener, sequence: int, *, session: int | None = 1, sealed_in: int = 1, epoch: int = 3
) -> bytes | Refusal:
    result = opener.open(epoch, HW, session, sequence, CLEAR, sealed(sequence, session=sealed_in))
    if isinstance(result, Refusal):
        return result
    opener.take(HW, result.session, sequence)
    return result.body


def test_what_a_member_sealed_another_opens() -> None:
    assert opened(Opener(GROUP), 7) == b"body"


def test_a_seal_adds_sixteen_bytes() -> None:
    assert len(sealed(1, body=b"x" * 100)) == 116


def test_a_stranger_with_another_group_key_is_refused() -> None:
    stranger = sealed(1, group=GroupKey(3, bytes(32)))
    assert Opener(GROUP).open(3, HW, 1, 1, CLEAR, stranger) is Refusal.FORGED


@pytest.mark.parametrize("what", ["body", "clear header", "sender", "sequence"])
def test_any_change_is_refused(what: str) -> None:
    box = sealed(5)
    hw, sequence, clear = HW, 5, CLEAR
    if what == "body":
        box = bytes([box[0] ^ 1]) + box[1:]
    elif what == "clear header":
        clear = b"The clear header"
    elif what == "sender":
        hw += 1
    else:
        sequence += 1
    assert Opener(GROUP).open(3, hw, 1, sequence, clear, box) is Refusal.FORGED


@given(st.binary(max_size=200))
def test_garbage_is_refused(box: bytes) -> None:
    assert Opener(GROUP).open(3, HW, 1, 1, CLEAR, box) is Refusal.FORGED


def test_a_datagram_is_taken_once() -> None:
    opener = Opener(GROUP)
    assert opened(opener, 1) == b"body"
    assert opened(opener, 1) is Refusal.REPLAYED


def test_refused_datagram_uses_no_number() -> None:
    opener = Opener(GROUP)
    for sequence in (5, 900_000, 5):
        assert isinstance(opener.open(3, HW, 1, sequence, CLEAR, sealed(sequence)), Opened)
    assert opened(opener, 5) == b"body"
    opener.take(HW, 2, 6)
    opener.take(HW + 1, 1, 6)
    assert opened(opener, 6) == b"body", "another session, another sender"


def test_overtaken_datagrams_are_taken_within_window_and_once() -> None:
    opener = Opener(GROUP)
    opened(opener, 1000)
    for behind in (1, 5, REPLAY_WINDOW - 1):
        assert opened(opener, 1000 - behind) == b"body"
        assert opened(opener, 1000 - behind) is Refusal.REPLAYED
    assert opened(opener, 1000 - REPLAY_WINDOW) is Refusal.REPLAYED


def test_jump_ahead_forgets_what_is_behind_window() -> None:
    opener = Opener(GROUP)
    opened(opener, 1)
    assert opened(opener, 1 + REPLAY_WINDOW) == b"body"
    assert opened(opener, 1) is Refusal.REPLAYED
    assert opened(opener, 2) == b"body"


@given(st.lists(st.integers(0, 200), max_size=60))
def test_no_order_of_arrival_lets_datagram_in_twice(order: list[int]) -> None:
    opener = Opener(GROUP)
    taken: set[int] = set()
    for sequence in order:
        result = opened(opener, sequence)
        if isinstance(result, bytes):
            assert sequence not in taken
            taken.add(sequence)
        else:
            assert result is Refusal.REPLAYED


def test_session_before_first_beacon_is_unknown() -> None:
    assert opened(Opener(GROUP), 1, session=None) is Refusal.UNKNOWN


def test_datagrams_after_first_may_omit_session() -> None:
    opener = Opener(GROUP)
    opened(opener, 1)
    assert opened(opener, 2, session=None) == b"body"


def test_sessions_of_one_sender_have_own_numbers() -> None:
    opener = Opener(GROUP)
    opened(opener, 1000)
    assert opened(opener, 1, session=2, sealed_in=2) == b"body"
    assert opened(opener, 1001) == b"body"
    assert opened(opener, 1001) is Refusal.REPLAYED
    assert opened(opener, 1002, session=None) == b"body"
    assert opened(opener, 2, session=None, sealed_in=2) == b"body"
    assert opened(opener, 2, session=2, sealed_in=2) is Refusal.REPLAYED
    last = opener.open(3, HW, None, 3, CLEAR, sealed(3, session=2))
    assert isinstance(last, Opened)
    assert last.session == 2


def test_no_number_of_other_sessions_displaces_adopted_one() -> None:
    opener = Opener(GROUP)
    opened(opener, 1000)
    opener.adopt(HW, 1)
    for session in range(2, 30):
        assert opened(opener, 1, session=session, sealed_in=session) == b"body"
    assert opened(opener, 1001, session=None) == b"body"
    assert opened(opener, 1000) is Refusal.REPLAYED
    opener.adopt(HW, 29)
    assert opened(opener, 2, session=None, sealed_in=29) == b"body"


def test_forged_new_session_does_not_end_old_one() -> None:
    opener = Opener(GROUP)
    opened(opener, 1)
    assert opener.open(3, HW, 9, 2, CLEAR, b"x" * 40) is Refusal.FORGED
    assert opened(opener, 2, session=None) == b"body"


def test_another_key_epoch_is_refused() -> None:
    assert opened(Opener(GROUP), 1, epoch=4) is Refusal.EPOCH


def test_two_senders_never_share_a_key() -> None:
    one, other = Sealer(GROUP, 1, 1), Sealer(GROUP, 2, 1)
    assert one.seal(1, CLEAR, bytes(32))[:32] != other.seal(1, CLEAR, bytes(32))[:32]


def test_a_sequence_number_is_sealed_once() -> None:
    sealer = Sealer(GROUP, HW, 1)
    sealer.seal(5, CLEAR, b"")
    for sequence in (5, 4):
        with pytest.raises(InvalidInput, match="expected more than 5"):
            sealer.seal(sequence, CLEAR, b"")


def test_made_keys_are_loaded_and_belong_together(tmp_path: Path) -> None:
    roster = make_swarm(tmp_path, ["uav1", "gcs"])
    keys = {name: Keys.load(tmp_path / name, name) for name in ("uav1", "gcs")}
    assert keys["uav1"].group == keys["gcs"].group
    assert [member.platform for member in roster.members] == ["uav1", "gcs"]
    assert keys["gcs"].by_curve(keys["uav1"].curve_public) == roster.find("uav1")
    assert keys["gcs"].curve_of("uav1") == keys["uav1"].curve_public
    assert not keys["uav1"].is_open


def test_roles_are_given_by_a_mapping(tmp_path: Path) -> None:
    roster = make_swarm(tmp_path, {"uav1": "node", "gcs": "operator"})
    gcs = roster.find("gcs")
    assert gcs is not None
    assert gcs.role == "operator"


def test_curve_key_equals_zeromqs(tmp_path: Path) -> None:
    make_swarm(tmp_path, ["uav1"])
    keys = Keys.load(tmp_path / "uav1", "uav1")
    secret_z85 = z85.encode(keys.curve_secret)
    assert z85.decode(zmq.curve_public(secret_z85)) == keys.curve_public


def test_a_member_signs_what_the_roster_can_check(tmp_path: Path) -> None:
    roster = make_swarm(tmp_path, ["uav1"])
    signature = Keys.load(tmp_path / "uav1", "uav1").sign(b"order")
    member = roster.find("uav1")
    assert member is not None
    Ed25519PublicKey.from_public_bytes(member.sign_public).verify(signature, b"order")


def test_secrets_are_for_their_owner_alone(tmp_path: Path) -> None:
    make_swarm(tmp_path, ["uav1"])
    for name in ("root.key", "group.key", "uav1/node.key"):
        assert stat.S_IMODE((tmp_path / name).stat().st_mode) == 0o600


def test_seed_that_others_can_read_is_not_used(tmp_path: Path) -> None:
    make_swarm(tmp_path, ["uav1"])
    (tmp_path / "uav1" / "node.key").chmod(0o644)
    with pytest.raises(Denied, match="expected mode 0600"):
        Keys.load(tmp_path / "uav1", "uav1")


def test_the_key_of_another_node_is_not_used(tmp_path: Path) -> None:
    make_swarm(tmp_path, ["uav1", "uav2"])
    with pytest.raises(Denied, match="not the key that the roster has for uav2"):
        Keys.load(tmp_path / "uav1", "uav2")


def test_platform_that_is_not_on_roster_is_denied(tmp_path: Path) -> None:
    make_swarm(tmp_path, ["uav1"])
    with pytest.raises(Denied, match="uav9 is not on the roster"):
        Keys.load(tmp_path / "uav1", "uav9")


def test_roster_that_root_did_not_sign_is_denied(tmp_path: Path) -> None:
    roster = make_swarm(tmp_path, ["uav1"])
    file = tmp_path / "uav1" / "roster.json"
    file.write_bytes(sign_roster(roster, SigningKey(OTHER_SEED)))
    with pytest.raises(Denied, match="not signed by this swarm's root"):
        Keys.load(tmp_path / "uav1", "uav1")


def test_a_revoked_member_is_a_stranger(tmp_path: Path) -> None:
    root = SigningKey(OTHER_SEED)
    member = RosterMember("uav1", bytes(32), b"\1" * 32, serial=1)
    roster = Roster(2, (member,), revoked=(1,), sign_beacons=True)
    (tmp_path / "roster.json").write_bytes(sign_roster(roster, root))
    read = read_roster(tmp_path / "roster.json", root.public)
    assert read == roster
    assert read.find("uav1") is None
    assert Keys("gcs", bytes(32), read, GROUP).by_curve(b"\1" * 32) is None


@pytest.mark.parametrize("name", ["node.key", "roster.json", "root.pub"])
@pytest.mark.parametrize("damage", [b"", b"garbage", b"{}\n00\n", None])
def test_a_missing_or_damaged_file_is_named(tmp_path: Path, name: str, damage: bytes | None) -> None:
    make_swarm(tmp_path, ["uav1"])
    file = tmp_path / "uav1" / name
    if damage is None:
        file.unlink()
    else:
        file.write_bytes(damage)
    with pytest.raises((ConfigError, Denied), match=r"roster|key|root\.pub"):
        Keys.load(tmp_path / "uav1", "uav1")


def test_names_that_are_none_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="platform name"):
        make_swarm(tmp_path, ["../uav1"])


def test_open_keys_share_group_with_own_identity() -> None:
    one, other = Keys.open("uav1"), Keys.open("uav2")
    assert one.is_open
    assert one.group == other.group
    assert one.curve_public != other.curve_public
    assert one.by_curve(other.curve_public) is None
    assert one.curve_of("uav2") is None
