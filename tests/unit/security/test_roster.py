"""The root's rosters, and nodes that take them: admission, revocation, rotation."""

import stat
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.security.former_roster import former
from tests.unit.security.swarm import NAMES, Swarm

from swarmware.errors import ConfigError, Conflict, Denied, InvalidInput, NotFound
from swarmware.transport.enrolment.token import fingerprint
from swarmware.transport.security.keys import FORMER_MAX, Keys, read_roster, write_keys
from swarmware.transport.security.root import FORMER_KEYS_MAX, Candidate, Root, candidate, make_swarm
from swarmware.transport.security.roster import (
    Roster,
    RosterMember,
    parse_roster,
    sign_roster,
)
from swarmware.transport.sodium import SigningKey


@pytest.fixture
def swarm(tmp_path: Path) -> Swarm:
    return Swarm(tmp_path / "swarm")


def test_member_takes_new_roster_during_key_use(swarm: Swarm) -> None:
    text = swarm.admit("uav3", b"\3" * 32, "operator")
    change = swarm.keys["uav1"].apply(text)
    assert change is not None
    assert [member.platform for member in change.came] == ["uav3"]
    assert not (change.gone or change.changed or change.rotated or change.revoked_self)
    fresh = swarm.root.roster.find("uav3")
    assert fresh is not None
    assert swarm.keys["uav1"].by_curve(fresh.curve_public) == fresh
    assert swarm.keys["uav1"].by_user(fresh.user) == fresh


def test_same_key_with_new_name_renames_member(swarm: Swarm) -> None:
    keys = swarm.keys["uav1"]
    change = keys.apply(swarm.admit("uav3", b"\3" * 32))
    assert change is not None and change.renamed == {}
    change = keys.apply(swarm.admit("scout", b"\3" * 32))
    assert change is not None and change.renamed == {"uav3": "scout"}
    change = keys.apply(swarm.admit("scout", b"\4" * 32))
    assert change is not None and change.renamed == {}, "a new computer in the place of scout"
    with pytest.raises(NotFound, match="uav9 is not a member of the swarm; expected one of gcs, uav1"):
        swarm.root.revoke("uav9")


def test_newcomer_has_same_group_key_as_members(swarm: Swarm, tmp_path: Path) -> None:
    text = swarm.admit("uav3", b"\3" * 32)
    write_keys(tmp_path / "uav3", b"\3" * 32, swarm.root.public, text)
    assert Keys.load(tmp_path / "uav3", "uav3").group == swarm.keys["uav1"].group


def test_rotation_gives_every_member_same_new_key(swarm: Swarm) -> None:
    text = swarm.root.rotate()
    before = swarm.keys["uav1"].group
    for keys in swarm.keys.values():
        change = keys.apply(text)
        assert change is not None
        assert change.rotated
        assert not (change.came or change.gone)
    assert len({keys.group.key for keys in swarm.keys.values()}) == 1
    assert swarm.keys["uav1"].group.epoch == before.epoch + 1
    assert swarm.keys["uav1"].group.key != before.key
    assert swarm.keys["uav1"].former == (before,)


def test_revoked_member_learns_it_without_next_key(swarm: Swarm) -> None:
    text = swarm.root.revoke("uav2")
    revoked, left = swarm.keys["uav2"], swarm.keys["uav1"]
    gone = left.by_curve(revoked.curve_public)
    assert gone is not None
    change = left.apply(text)
    assert change is not None
    assert (change.gone, change.rotated, change.revoked_self) == ((gone,), True, False)
    assert left.by_curve(revoked.curve_public) is None
    assert left.by_user(gone.user) is None
    assert left.curve_of("uav2") is None
    own = revoked.apply(text)
    assert own is not None
    assert own.revoked_self
    assert revoked.is_revoked
    assert revoked.group.epoch == 0
    entry = next(each for each in swarm.root.roster.members if each.platform == "uav2")
    assert entry.group_box == b""


def test_rejoining_platform_gets_new_serial_and_key(swarm: Swarm) -> None:
    before = swarm.root.roster.find("uav2")
    assert before is not None
    text = swarm.admit("uav2", b"\7" * 32)
    after = swarm.root.roster.find("uav2")
    assert after is not None
    assert after.serial > max(member.serial for member in (before, *swarm.root.roster.members[:-1]))
    change = swarm.keys["uav1"].apply(text)
    assert change is not None
    assert (change.came, change.gone, change.rotated) == ((after,), (before,), True)
    assert swarm.keys["uav1"].by_curve(before.curve_public) is None
    replaced = swarm.keys["uav2"].apply(text)
    assert replaced is not None
    assert replaced.revoked_self


def test_no_serial_is_used_twice(swarm: Swarm) -> None:
    given = {member.serial for member in swarm.root.roster.members}
    for seed in range(10, 15):
        swarm.admit("uav2", bytes([seed]) * 32)
        swarm.root.revoke("uav2")
    serials = [*given, *(entry for entry in swarm.root.roster.revoked)]
    assert swarm.admit("uav2", b"\7" * 32)
    fresh = swarm.root.roster.find("uav2")
    assert fresh is not None
    assert fresh.serial not in serials


def test_roster_keeps_only_last_replaced_keys(swarm: Swarm) -> None:
    for seed in range(10, 16):
        text = swarm.admit("uav2", bytes([seed]) * 32)
    members = swarm.root.roster.members
    assert len(members) == len(NAMES) + FORMER_KEYS_MAX
    former = [member for member in members if member.serial in swarm.root.roster.revoked]
    expected = [SigningKey(bytes([seed]) * 32).public for seed in range(15 - FORMER_KEYS_MAX, 15)]
    assert [member.sign_public for member in former] == expected
    assert {member.group_box for member in former} == {b""}
    other = swarm.keys["uav1"]
    other.apply(text)
    assert {other.revoked(member.curve_public) for member in former} == {"uav2"}
    assert other.sign_public_of("uav2") == SigningKey(bytes([15]) * 32).public


def test_a_key_that_returns_is_no_former_one(swarm: Swarm) -> None:
    swarm.admit("uav2", b"\4" * 32)
    swarm.admit("uav2", b"\5" * 32)
    swarm.admit("uav2", b"\4" * 32)
    entries = [member for member in swarm.root.roster.members if member.platform == "uav2"]
    assert [member.sign_public for member in entries[1:]] == [
        SigningKey(bytes([seed]) * 32).public for seed in (5, 4)
    ]


def test_a_member_with_another_role_is_named(swarm: Swarm) -> None:
    seed = (swarm.directory / "uav1" / "node.key").read_bytes()
    change = swarm.keys["gcs"].apply(swarm.admit("uav1", seed, "operator"))
    assert change is not None
    assert not (change.rotated or change.came or change.gone)
    assert [member.role for member in change.changed] == ["operator"]
    assert not swarm.keys["uav1"].is_revoked


def test_an_older_or_the_same_roster_changes_nothing(swarm: Swarm) -> None:
    older, newer = swarm.root.rotate(), swarm.root.rotate()
    keys = swarm.keys["uav1"]
    assert keys.apply(newer) is not None
    held = keys.roster
    assert keys.apply(older) is None
    assert keys.apply(newer) is None
    assert keys.roster is held


def test_a_roster_of_another_root_is_denied(swarm: Swarm) -> None:
    roster = msgspec.structs.replace(swarm.root.roster, version=99)
    with pytest.raises(Denied, match="not signed by this swarm's root"):
        swarm.keys["uav1"].apply(sign_roster(roster, SigningKey(b"\5" * 32)))
    assert swarm.keys["uav1"].roster == swarm.root.roster


def test_a_node_without_keys_takes_no_roster(swarm: Swarm) -> None:
    with pytest.raises(Denied, match="uav9 has no keys"):
        Keys.open("uav9").apply(swarm.root.signed)


@given(data=st.data())
def test_any_change_of_a_roster_is_refused(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    key = SigningKey(bytes(32))
    member = RosterMember("uav1", bytes(32), bytes(32), serial=1)
    text = sign_roster(Roster(2, (member,), sign_beacons=True), key)
    at = data.draw(st.integers(0, len(text) - 2))
    value = data.draw(st.integers(0, 255).filter(lambda value: value != text[at]))
    changed = text[:at] + bytes([value]) + text[at + 1 :]
    try:
        assert parse_roster(changed, key.public, "roster") == parse_roster(text, key.public, "roster")
    except (ConfigError, Denied):
        return
    assert changed.lower() == text.lower() or changed.split() == text.split()  # hex digits, white space


MEMBER = RosterMember("uav1", bytes(32), bytes(32), serial=1)
REPLACED = msgspec.structs.replace


@pytest.mark.parametrize(
    ("members", "reason"),
    [
        ((REPLACED(MEMBER, platform="../uav1"),), "platform name"),
        ((REPLACED(MEMBER, role="king"),), "role 'king'"),
        ((REPLACED(MEMBER, sign_public=b"short"),), "a key of 5 bytes"),
        ((REPLACED(MEMBER, curve_public=b""),), "a key of 0 bytes"),
        ((REPLACED(MEMBER, group_box=b"short"),), "a group_box of 5 bytes"),
        ((MEMBER, REPLACED(MEMBER, platform="uav2")), "serial 1 is used twice"),
        ((MEMBER, REPLACED(MEMBER, serial=2)), "two valid entries"),
    ],
)
def test_a_signed_but_useless_roster_is_refused(members: tuple[RosterMember, ...], reason: str) -> None:
    key = SigningKey(bytes(32))
    with pytest.raises(ConfigError, match=reason):
        parse_roster(sign_roster(Roster(1, members, sign_beacons=True), key), key.public, "roster")


def test_what_was_applied_is_there_after_a_restart(swarm: Swarm) -> None:
    keys = swarm.keys["uav1"]
    for _ in range(3):
        keys.apply(swarm.root.rotate())
    keys.save(swarm.directory / "uav1")
    again = swarm.reload("uav1")
    assert (again.roster, again.group, again.former) == (keys.roster, keys.group, keys.former)
    assert [group.epoch for group in again.former] == [2, 1, 0]
    assert stat.S_IMODE((swarm.directory / "uav1" / "group.keys").stat().st_mode) == 0o600


def test_kill_during_rotation_leaves_loadable_keys(swarm: Swarm) -> None:
    keys, folder = swarm.keys["uav1"], swarm.directory / "uav1"
    former = (folder / "roster.json").read_bytes()
    keys.apply(swarm.root.rotate())
    keys.save(folder)
    (folder / "roster.json").write_bytes(former)  # the roster was not replaced yet
    again = swarm.reload("uav1")
    assert (again.group.epoch, again.former) == (0, ())
    assert again.apply(swarm.root.signed) is not None
    assert again.group == keys.group


def test_node_keeps_distinguishable_group_keys(swarm: Swarm) -> None:
    keys = swarm.keys["uav1"]
    for _ in range(20):
        keys.apply(swarm.root.rotate())
    assert [group.epoch for group in keys.former] == list(range(19, 4, -1))
    assert len(keys.former) == FORMER_MAX
    assert len({group.mark for group in (keys.group, *keys.former)}) == 16


def test_a_node_that_missed_rotations_takes_the_newest(swarm: Swarm) -> None:
    for _ in range(5):
        text = swarm.root.rotate()
    keys = swarm.keys["uav1"]
    assert keys.apply(text) is not None
    assert keys.group.epoch == 5
    assert [group.epoch for group in keys.former] == [0]


def test_group_key_for_another_node_is_named(tmp_path: Path) -> None:
    make_swarm(tmp_path, ["uav1", "uav2"])
    key = SigningKey((tmp_path / "root.key").read_bytes())
    roster = read_roster(tmp_path / "uav1" / "roster.json", key.public)
    one, two = roster.members
    swapped = (
        msgspec.structs.replace(one, group_box=two.group_box),
        msgspec.structs.replace(two, group_box=one.group_box),
    )
    text = sign_roster(msgspec.structs.replace(roster, members=swapped), key)
    (tmp_path / "uav1" / "roster.json").write_bytes(text)
    with pytest.raises(ConfigError, match="not sealed to its key"):
        Keys.load(tmp_path / "uav1", "uav1")


def test_revoked_node_differs_from_unknown_at_start(swarm: Swarm) -> None:
    (swarm.directory / "uav1" / "roster.json").write_bytes(swarm.root.revoke("uav1"))
    with pytest.raises(Denied, match="uav1 was revoked"):
        swarm.reload("uav1")


def test_a_root_is_not_overwritten(swarm: Swarm) -> None:
    with pytest.raises(Conflict, match=r"root\.key: there is a root already"):
        Root.make(swarm.directory)
    assert Root.load(swarm.directory).roster == swarm.root.roster


def test_a_root_continues_where_it_was(swarm: Swarm) -> None:
    swarm.root.revoke("uav2")
    again = Root.load(swarm.directory)
    assert again.signed == swarm.root.signed
    text = again.admit(candidate("uav3", "node", b"\3" * 32, again.public))
    assert swarm.keys["uav1"].apply(text) is not None
    assert swarm.keys["uav1"].roster == again.roster


def test_root_killed_during_rotation_rotates_with_next(swarm: Swarm) -> None:
    former = (swarm.directory / "roster.json").read_bytes()
    swarm.root.rotate()
    (swarm.directory / "roster.json").write_bytes(former)
    again = Root.load(swarm.directory)
    text = again.admit(candidate("uav3", "node", b"\3" * 32, again.public))
    groups = set[bytes]()
    for name in NAMES:
        assert swarm.keys[name].apply(text) is not None
        groups.add(swarm.keys[name].group.key)
    assert len(groups) == 1


def test_candidate_without_proof_of_key_is_denied(swarm: Swarm) -> None:
    good = candidate("uav3", "node", b"\3" * 32, swarm.root.public)
    key = SigningKey(b"\4" * 32)
    for bad in (
        Candidate("uav4", "node", good.sign_public, good.proof),  # made for another name
        Candidate("uav3", "node", key.public, good.proof),
        candidate("uav3", "node", b"\3" * 32, key.public),  # made for another root
    ):
        with pytest.raises(Denied, match="has not proven its key"):
            swarm.root.admit(bad)
    assert swarm.root.roster.version == 1


@pytest.mark.parametrize(("name", "role"), [("../uav3", "node"), ("uav3", "king")])
def test_candidate_of_invalid_name_or_role_is_refused(swarm: Swarm, name: str, role: str) -> None:
    with pytest.raises(InvalidInput):
        swarm.admit(name, b"\3" * 32, role)
    assert swarm.root.roster.version == 1


def test_who_is_no_member_cannot_be_revoked(swarm: Swarm) -> None:
    swarm.root.revoke("uav2")
    for name in ("uav9", "uav2"):
        with pytest.raises(NotFound, match=f"{name} is not a member"):
            swarm.root.revoke(name)


def test_a_fingerprint_names_one_root(swarm: Swarm) -> None:
    assert len(fingerprint(swarm.root.public)) == 32
    assert fingerprint(swarm.root.public) != fingerprint(bytes(32))


def test_only_revoked_key_is_known_as_such(
    swarm: Swarm,
) -> None:
    left, key = swarm.keys["uav1"], swarm.keys["uav2"].curve_public
    assert left.revoked(key) == ""
    left.apply(swarm.root.revoke("uav2"))
    assert left.revoked(key) == "uav2"
    assert left.revoked(left.curve_public) == left.revoked(bytes(32)) == ""


def test_roster_without_signed_beacons_names_key_command(
    swarm: Swarm,
) -> None:
    text = former(swarm.root.signed, SigningKey((swarm.directory / "root.key").read_bytes()))
    before = swarm.keys["uav1"].signed
    with pytest.raises(ConfigError, match="swarmctl keys init --replace --root DIR"):
        swarm.keys["uav1"].apply(text)
    assert swarm.keys["uav1"].signed == before
    for path in (swarm.directory / "uav1" / "roster.json", swarm.directory / "roster.json"):
        path.write_bytes(text)
    with pytest.raises(ConfigError, match=r"roster\.json: a roster of a former version, in which not every"):
        swarm.reload("uav1")
    with pytest.raises(ConfigError, match="swarmctl keys join --replace"):
        Root.load(swarm.directory)
