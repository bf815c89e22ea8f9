"""The exchange of the roster between neighbours: questions, differences, refusals, key epochs."""

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from tests.unit.security.swarm import Swarm

from swarmd.broker.core.beacon.beacon import Beacon, MemberRow, PlatformCode, RelayedValue, RouteRow
from swarmd.broker.core.membership.group_epochs import ACCEPT_NS, SWITCH_NS, GroupEpochs
from swarmd.broker.core.membership.roster import roster_update
from swarmd.broker.core.membership.roster.roster_exchange import (
    AGAIN_NS,
    ANSWER_NS,
    UNANSWERED_MAX,
    ApplyRoster,
    RosterAction,
    RosterExchange,
    SendRoster,
)
from swarmd.broker.core.membership.roster.roster_update import (
    RosterOffer,
    RosterQuestion,
    RosterUpdate,
    decode,
    encode,
    make_update,
    merge,
)
from swarmware.errors import ConfigError, Denied, WireError
from swarmware.model.names import hardware_id
from swarmware.transport.security.roster import sign_roster
from swarmware.transport.security.seal import GroupKey
from swarmware.transport.sodium import SigningKey

SECOND = 1_000_000_000
HW = {name: hardware_id(name) for name in ("gcs", "uav1", "uav2", "uav3")}
HOST = "10.0.0.9"
GARBAGE = [b"", b"garbage", b"\x90", b"\x93\x09\x01\x02", b"\xc1", b"\x92\x02\xa1x"]
DAMAGED = [b"", b"garbage", b"{}\n00\n", b'{"version":5}\n', b'{"version":"x"}\n00\n']


@pytest.fixture
def swarm(tmp_path: Path) -> Swarm:
    return Swarm(tmp_path / "swarm")


def exchange(swarm: Swarm, name: str) -> RosterExchange:
    made = RosterExchange(swarm.keys[name], HW[name], lambda: 0.0)
    made.port = 7447
    return made


def sent(actions: list[RosterAction]) -> tuple[SendRoster, roster_update.RosterMessage]:
    (action,) = actions
    assert isinstance(action, SendRoster)
    return action, decode(action.payload)


def carry(actions: list[RosterAction], to: RosterExchange, sender: str, now_ns: int) -> list[RosterAction]:
    (action,) = [each for each in actions if isinstance(each, SendRoster)]
    return to.on_message(HW[sender], sender, action.payload, HOST, now_ns)


def test_node_behind_asks_and_gets_only_difference(swarm: Swarm) -> None:
    one, other = exchange(swarm, "uav1"), exchange(swarm, "uav2")
    one.on_text(swarm.admit("uav3", b"\3" * 32), 0)
    other.on_shown(HW["uav1"], "uav1", one.version, 0)
    question = other.advance(0)
    action, message = sent(question)
    assert (action.hw, message) == (HW["uav1"], RosterQuestion(1, 7447))
    answer = carry(question, one, "uav2", 1)
    update = sent(answer)[1]
    assert isinstance(update, RosterUpdate)
    assert update.base == 1
    assert [member.platform for member in update.members] == ["uav3"]
    assert len(encode(update)) < 400
    (applied,) = carry(answer, other, "uav1", 2)
    assert isinstance(applied, ApplyRoster)
    assert other.version == one.version == 2
    assert other.deadline_ns() is None


@pytest.mark.parametrize("change", ["admit", "again", "revoke", "rotate", "role"])
def test_difference_leads_to_roster_that_root_signed(swarm: Swarm, change: str) -> None:
    base = swarm.root.roster
    seed = (swarm.directory / "uav1" / "node.key").read_bytes()
    changes: dict[str, Callable[[], bytes]] = {
        "admit": lambda: swarm.admit("uav3", b"\3" * 32),
        "again": lambda: swarm.admit("uav2", b"\4" * 32),
        "revoke": lambda: swarm.root.revoke("uav2"),
        "rotate": swarm.root.rotate,
        "role": lambda: swarm.admit("uav1", seed, "operator"),
    }
    text = changes[change]()
    update = make_update(base, swarm.root.roster, text)
    assert update.base == base.version, "the difference is enough"
    assert merge(base, update) == text


def test_differently_encoded_roster_is_sent_whole(swarm: Swarm) -> None:
    base, key = swarm.root.roster, SigningKey((swarm.directory / "root.key").read_bytes())
    swarm.root.rotate()
    body = msgspec.json.encode(swarm.root.roster).replace(b'{"version"', b'{ "version"')
    text = body + b"\n" + key.sign(body).hex().encode() + b"\n"
    update = make_update(base, swarm.root.roster, text)
    assert (update.base, update.whole) == (0, text)


def test_node_that_restarted_answers_with_whole_roster(swarm: Swarm) -> None:
    one, other = exchange(swarm, "uav1"), exchange(swarm, "uav2")
    one.on_text(swarm.root.rotate(), 0)
    again = exchange(swarm, "uav1")
    other.on_shown(HW["uav1"], "uav1", 2, 0)
    answer = carry(other.advance(0), again, "uav2", 1)
    update = sent(answer)[1]
    assert isinstance(update, RosterUpdate)
    assert update.base == 0
    carry(answer, other, "uav1", 2)
    assert other.version == 2


def test_another_neighbour_is_asked_when_no_answer_comes(swarm: Swarm) -> None:
    node = exchange(swarm, "uav1")
    for name in ("uav2", "gcs"):
        node.on_shown(HW[name], name, 2, 0)
    first = sent(node.advance(0))[0].hw
    assert node.advance(ANSWER_NS - 1) == []
    second = sent(node.advance(ANSWER_NS))[0].hw
    assert {first, second} == {HW["uav2"], HW["gcs"]}


def test_who_never_answers_is_not_asked_for_ever(swarm: Swarm) -> None:
    node, asked = exchange(swarm, "uav1"), 0
    node.on_shown(HW["uav2"], "uav2", 2, 0)
    now_ns = 0
    while (now_ns := node.deadline_ns()) is not None:  # type: ignore[assignment]
        asked += len(node.advance(now_ns))
        assert asked <= 2 * UNANSWERED_MAX
    node.on_shown(HW["uav2"], "uav2", 2, 60 * SECOND)
    assert node.deadline_ns() is not None, "it shows its version again"


def test_forged_roster_is_refused_and_sender_avoided(swarm: Swarm) -> None:
    node = exchange(swarm, "uav1")
    node.on_shown(HW["uav2"], "uav2", 99, 0)
    node.advance(0)
    forged = sign_roster(msgspec.structs.replace(swarm.root.roster, version=99), SigningKey(b"\5" * 32))
    with pytest.raises(Denied, match="not signed"):
        node.on_message(HW["uav2"], "uav2", encode(RosterUpdate(0, forged)), HOST, 1)
    assert node.version == 1
    assert node.deadline_ns() is None


def test_forged_difference_is_refused_and_whole_requested(swarm: Swarm) -> None:
    node, base = exchange(swarm, "uav1"), swarm.root.roster
    swarm.root.rotate()
    update = make_update(base, swarm.root.roster, swarm.root.signed)
    node.on_shown(HW["uav2"], "uav2", 2, 0)
    node.advance(0)
    with pytest.raises(Denied, match="not signed"):
        node.on_message(HW["uav2"], "uav2", encode(msgspec.structs.replace(update, swarm="x")), HOST, 1)
    assert node.version == 1
    assert sent(node.advance(2))[1] == RosterQuestion(0, 7447)


def test_an_older_roster_is_refused(swarm: Swarm) -> None:
    node, older = exchange(swarm, "uav1"), swarm.root.signed
    node.on_text(swarm.root.rotate(), 0)
    with pytest.raises(ConfigError, match="older than 2"):
        node.on_message(HW["uav2"], "uav2", encode(RosterUpdate(0, older)), HOST, 1)
    assert node.version == 2


@pytest.mark.parametrize("payload", GARBAGE)
def test_a_message_that_cannot_be_read_is_refused(swarm: Swarm, payload: bytes) -> None:
    with pytest.raises(WireError):
        exchange(swarm, "uav1").on_message(HW["uav2"], "uav2", payload, HOST, 0)


@pytest.mark.parametrize("whole", DAMAGED)
def test_a_damaged_roster_is_refused(swarm: Swarm, whole: bytes) -> None:
    with pytest.raises((ConfigError, Denied)):
        exchange(swarm, "uav1").on_message(HW["uav2"], "uav2", encode(RosterUpdate(0, whole)), HOST, 0)


def test_group_keys_not_matching_members_are_refused(swarm: Swarm) -> None:
    base = swarm.root.roster
    text = swarm.root.rotate()
    update = make_update(base, swarm.root.roster, text)
    with pytest.raises(WireError, match="do not fit its members"):
        merge(base, msgspec.structs.replace(update, boxes=update.boxes[:-1]))


def test_node_missing_rotations_is_offered_roster(swarm: Swarm) -> None:
    present, late = exchange(swarm, "uav1"), exchange(swarm, "uav2")
    for _ in range(3):
        present.on_text(swarm.root.rotate(), 0)
    assert present.former_key(swarm.keys["uav2"].group.mark) == swarm.keys["uav2"].group
    offer = present.on_late(HW["uav2"], "uav2", 1, "10.0.0.2", 7000, SECOND)
    action, message = sent(offer)
    assert (action.host, action.port, message) == ("10.0.0.2", 7000, RosterOffer(4, 7447))
    assert present.on_late(HW["uav2"], "uav2", 1, "10.0.0.2", 7000, SECOND + 1) == [], "once in a while"
    question = carry(offer, late, "uav1", SECOND)
    action, _ = sent(question)
    assert (action.host, action.port) == (HOST, 7447)
    answer = carry(question, present, "uav2", SECOND)
    assert (sent(answer)[0].host, sent(answer)[0].port) == (HOST, 7447)
    carry(answer, late, "uav1", SECOND)
    assert late.version == 4
    assert late.switch_epoch((), SECOND)
    assert late.epochs.sealing == present.epochs.opening(3, SECOND)


def test_unknown_node_of_former_epoch_is_offered_nothing(swarm: Swarm) -> None:
    node = exchange(swarm, "uav1")
    node.on_text(swarm.root.rotate(), 0)
    assert node.on_late(hardware_id("uav9"), "uav9", 1, "10.0.0.2", 7000, SECOND) == []


def test_revoked_platform_learns_it_at_return(swarm: Swarm) -> None:
    node, away = exchange(swarm, "uav1"), exchange(swarm, "uav2")
    node.on_text(swarm.root.revoke("uav2"), 0)
    assert node.is_offer_due(HW["uav2"], SECOND)
    told = node.on_late(HW["uav2"], "uav2", 1, "10.0.0.2", 7000, SECOND)
    action, _ = sent(told)
    assert (action.host, action.port) == ("10.0.0.2", 7000)
    assert action.curve_public, "its key is not that of a member any more"
    assert not node.is_offer_due(HW["uav2"], 2 * SECOND)
    (applied,) = carry(told, away, "uav1", SECOND)
    assert isinstance(applied, ApplyRoster)
    assert applied.change.revoked_self
    again = node.on_late(HW["uav2"], "uav2", away.version, "10.0.0.2", 7000, 10 * SECOND)
    assert again == [], "it knows it now"


def test_returning_node_with_replaced_key_is_informed(
    swarm: Swarm,
) -> None:
    node, copy = exchange(swarm, "uav1"), exchange(swarm, "uav2")
    node.on_text(swarm.admit("uav2", b"\4" * 32), 0)
    told = node.on_late(HW["uav2"], "uav2", 1, "10.0.0.2", 7000, SECOND)
    action, _ = sent(told)
    assert action.curve_public == swarm.keys["uav2"].curve_public, "only this key opens the connection"
    (applied,) = carry(told, copy, "uav1", SECOND)
    assert isinstance(applied, ApplyRoster)
    assert applied.change.revoked_self
    offered, message = sent(node.on_late(HW["uav2"], "uav2", 1, "10.0.0.2", 7000, 10 * SECOND))
    assert (offered.curve_public, message) == (b"", RosterOffer(2, 7447))


def relayed(origin: str) -> RelayedValue:
    return RelayedValue(HW[origin], 5, 1000, 0, 1, packed=False, payload=b"value")


def test_revoked_node_is_left_out_of_beacon(swarm: Swarm) -> None:
    node = exchange(swarm, "uav1")
    beacon = Beacon(
        rows=(RouteRow(HW["uav2"], 1, 256), RouteRow(HW["gcs"], 1, 256)),
        members=(MemberRow(HW["uav2"], 1, PlatformCode.UAV, "uav2"),),
        relays=(relayed("uav2"), relayed("gcs")),
    )
    assert node.without_excluded(beacon) is beacon
    node.on_text(swarm.root.revoke("uav2"), 0)
    expected = Beacon(rows=(RouteRow(HW["gcs"], 1, 256),), relays=(relayed("gcs"),))
    assert node.without_excluded(beacon) == expected
    assert node.excludes(HW["uav2"])
    unit = hardware_id("uav2", "camera")
    assert not node.excludes(unit)
    assert node.excludes_name(unit, "uav2.camera")
    assert node.excludes(unit)
    assert not node.excludes_name(HW["gcs"], "gcs")


def test_revoked_neighbour_gets_roster_that_revokes_it(swarm: Swarm) -> None:
    node, revoked = exchange(swarm, "uav1"), exchange(swarm, "uav2")
    node.on_shown(HW["uav2"], "uav2", 1, 0)
    farewell = node.on_text(swarm.root.revoke("uav2"), 0)
    assert [type(action) for action in farewell] == [SendRoster, ApplyRoster]
    (applied,) = carry(farewell, revoked, "uav1", 1)
    assert isinstance(applied, ApplyRoster)
    assert applied.change.revoked_self
    assert not revoked.epochs.is_switching


KEYS = [GroupKey(epoch, bytes([epoch]) * 32) for epoch in range(20)]


def test_new_key_opens_at_once_and_seals_later() -> None:
    epochs = GroupEpochs(KEYS[0])
    epochs.rotate(KEYS[1], 0)
    assert epochs.sealing is KEYS[0]
    assert epochs.opening(1, 0) is KEYS[1]
    assert not epochs.switch(False, SWITCH_NS - 1)
    assert epochs.switch(True, SWITCH_NS - 1)
    assert epochs.sealing is KEYS[1]
    assert not epochs.switch(True, SWITCH_NS)


def test_new_key_seals_after_while_in_any_case() -> None:
    epochs = GroupEpochs(KEYS[0])
    epochs.rotate(KEYS[1], 0)
    epochs.rotate(KEYS[2], SWITCH_NS - 1)
    assert epochs.switch(False, SWITCH_NS)
    assert epochs.sealing is KEYS[2]


def test_the_former_key_opens_for_ten_seconds() -> None:
    epochs = GroupEpochs(KEYS[0])
    epochs.rotate(KEYS[1], 0)
    epochs.switch(True, 0)
    assert epochs.opening(0, ACCEPT_NS - 1) is KEYS[0]
    assert epochs.opening(0, ACCEPT_NS) is None
    assert epochs.opening(1, 100 * ACCEPT_NS) is KEYS[1]
    assert epochs.opening(7, 0) is None


def test_mark_after_sixteen_rotations_is_newest_keys() -> None:
    epochs = GroupEpochs(KEYS[0])
    for key in KEYS[1:17]:
        epochs.rotate(key, 0)
        epochs.switch(True, 0)
    assert epochs.opening(0, 0) is KEYS[16]


def test_endlessly_asking_node_is_answered_five_times(swarm: Swarm) -> None:
    node = exchange(swarm, "uav1")
    node.on_text(swarm.admit("uav3", b"\3" * 32), 0)
    question = encode(RosterQuestion(0, 7447))
    answers = [node.on_message(HW["uav2"], "uav2", question, HOST, n * AGAIN_NS // 100) for n in range(1000)]
    assert sum(map(len, answers)) == 10


def test_revoked_node_keeps_sealing_with_its_key(swarm: Swarm) -> None:
    revoked = exchange(swarm, "uav2")
    before = revoked.epochs.sealing
    revoked.on_text(swarm.root.revoke("uav2"), 0)
    assert revoked.epochs.sealing == before
    assert not revoked.switch_epoch((), SWITCH_NS)
