"""Which role may do what, and what a frame says of its sender."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.broker.core.membership.access_filter import UNKNOWN, AccessFilter
from swarmware.errors import ConfigError, Denied, WireError
from swarmware.model.access import Access, AccessRule, Role, Sender, Verb
from swarmware.model.frame import ADDRESSED, Flag, Frame, FrameKind
from swarmware.transport.delivery.answer import with_lifetime
from swarmware.transport.delivery.sender import (
    Caller,
    sender_and_arrival_ns,
    sender_of,
    with_caller,
    with_sender,
)
from swarmware.transport.security.roster import Roster, RosterMember

GCS = Sender("gcs", Role.OPERATOR)


@pytest.mark.parametrize(
    ("verb", "path", "lowest"),
    [
        (Verb.GET, "nav/pose", Role.OBSERVER),
        (Verb.CALL, "sys/tree/get", Role.OBSERVER),
        (Verb.CALL, "sys/tree/history", Role.OBSERVER),
        (Verb.CALL, "sys/node/config", Role.OBSERVER),
        (Verb.CALL, "sys/tree/reset", Role.NODE),
        (Verb.CALL, "sys/tree/subscribe", Role.OBSERVER),
        (Verb.CALL, "sys/tree/structure", Role.OBSERVER),
        (Verb.CALL, "sys/time/functions", Role.OBSERVER),
        (Verb.CALL, "sys/register/apps", Role.OBSERVER),
        (Verb.CALL, "sys/mission/status", Role.OBSERVER),
        (Verb.CALL, "sys/broker/traffic", Role.OBSERVER),
        (Verb.CALL, "sys/tree/notify", Role.NODE),
        (Verb.CALL, "plan/share", Role.NODE),
        (Verb.CALL, "cmd/mission", Role.OPERATOR),
        (Verb.CALL, "cmd/abort", Role.OPERATOR),
        (Verb.CALL, "sys/mission/task", Role.OPERATOR),
        (Verb.CALL, "sys/mission/abort", Role.OPERATOR),
        (Verb.CALL, "sys/vehicle/arm", Role.OPERATOR),
        (Verb.SET, "config/navigator/altitude_kp", Role.OPERATOR),
        (Verb.SET, "speed", Role.OPERATOR),
        (Verb.CALL, "sys/guard/restart", Role.MAINTAINER),
        (Verb.CALL, "sys/broker/set_channel", Role.OPERATOR),
        (Verb.CALL, "sys/broker/roster", Role.MAINTAINER),
        (Verb.CALL, "sys/what/comes/later", Role.MAINTAINER),
    ],
)
def test_each_path_has_a_lowest_role(verb: Verb, path: str, lowest: Role) -> None:
    access = Access()
    for role in Role:
        sender = Sender("uav2", role)
        if role >= lowest:
            access.check(sender, verb, path)
            continue
        with pytest.raises(Denied, match=rf"^{path}: {role.name.lower()}@uav2 may not {verb} it; expected"):
            access.check(sender, verb, path)


def test_platform_has_all_rights_on_its_own_resources() -> None:
    for path in ("cmd/abort", "sys/guard/restart", "sys/broker/set_channel"):
        Access().check(None, Verb.CALL, path)


def test_where_no_rule_matches_only_maintainers_may() -> None:
    access = Access((AccessRule(Verb.GET, "nav/*", "observer"),))
    access.check(Sender("a", Role.MAINTAINER), Verb.SET, "nav/pose")
    with pytest.raises(Denied, match=r"expected role maintainer$"):
        access.check(GCS, Verb.SET, "nav/pose")


def test_invalid_role_is_named_with_valid_ones() -> None:
    with pytest.raises(ConfigError, match="'admiral': expected one of observer, node, operator, maintainer"):
        Role.named("admiral")


def test_sender_in_extension_replaces_whatever_stood_there() -> None:
    lifetime = with_lifetime(2.0)
    forged = with_sender(lifetime, Sender("gcs", Role.MAINTAINER))
    assert sender_of(forged) == Sender("gcs", Role.MAINTAINER)
    assert sender_of(with_sender(forged, Sender("uav2", Role.NODE))) == Sender("uav2", Role.NODE)
    assert with_sender(forged, None) == lifetime
    assert sender_of(lifetime) is None


def test_arrival_replaces_former_extension_beside_sender() -> None:
    lifetime = with_lifetime(2.0)
    forged = with_sender(lifetime, GCS, 5)
    assert sender_and_arrival_ns(forged) == (GCS, 5)
    assert sender_and_arrival_ns(with_sender(forged, None, -7))[1] == -7
    assert sender_and_arrival_ns(lifetime)[1] is None
    assert with_sender(forged, None) == lifetime


@given(st.binary(max_size=255))
def test_any_extension_is_refused_or_names_sender(extension: bytes) -> None:
    sender_and_arrival_ns(extension)
    try:
        written = with_sender(extension, GCS, 2**62)
    except WireError:
        return
    assert sender_and_arrival_ns(written) == (GCS, 2**62)
    assert sender_of(with_sender(written, None)) is None


def gate() -> AccessFilter:
    names = {"gcs": "operator", "uav2": "node", "uav3": "node"}
    members = tuple(
        RosterMember(name, b"", b"", role, serial) for serial, (name, role) in enumerate(names.items())
    )
    return AccessFilter("uav9", Roster(1, members, revoked=(2,)).roles(), Access())


def question(kind: FrameKind = FrameKind.REQUEST, extension: bytes = b"") -> Frame:
    return Frame(kind, 1, 2, 3, 4, 5, flags=Flag.WANTS_ACK, extension=extension)


@pytest.mark.parametrize("kind", [*ADDRESSED, FrameKind.REQUEST])
def test_everything_that_an_application_takes_needs_the_right(kind: FrameKind) -> None:
    gate().check(question(kind), "gcs", "cmd/goto")
    for platform in ("uav2", "uav3", "nobody"):  # a node, a revoked node, a node outside the roster
        with pytest.raises(Denied):
            gate().check(question(kind), platform, "cmd/goto")
    with pytest.raises(Denied, match="observer@uav3"):
        gate().check(question(kind), "uav3", "plan/share")


def test_answers_and_what_nobody_takes_pass() -> None:
    gate().check(question(FrameKind.REPLY), "uav2", "cmd/goto")
    gate().check(question(FrameKind.ACK), "uav2", "cmd/goto")
    gate().check(question(), "uav2", None)


def test_sender_inside_frame_is_ignored() -> None:
    frame = question(extension=with_sender(b"", Sender("gcs", Role.MAINTAINER)))
    gate().check(frame, "uav2", "plan/share")
    assert sender_of(frame.extension) == Sender("uav2", Role.NODE)
    without_keys = AccessFilter("uav9", None, Access())
    without_keys.check(frame, "uav2", "sys/guard/restart")
    assert sender_of(frame.extension) is None


def test_arrival_inside_frame_is_ignored() -> None:
    for keys in (gate(), AccessFilter("uav9", None, Access())):
        asked = question(extension=with_sender(b"", None, 1))
        keys.check(asked, "uav2", "plan/share", 1000)
        assert sender_and_arrival_ns(asked.extension)[1] == 1000
        answered = question(FrameKind.REPLY, with_sender(b"", None, 1))
        keys.check(answered, "uav2", None, 1000)
        assert sender_and_arrival_ns(answered.extension)[1] is None


def test_user_has_lower_of_two_roles() -> None:
    for role, platform, expected in [
        (Role.OBSERVER, "gcs", Role.OBSERVER),
        (Role.MAINTAINER, "gcs", Role.OPERATOR),
        (Role.OPERATOR, "uav2", Role.NODE),
    ]:
        frame = question(extension=with_caller(with_lifetime(2.0), Caller("anna", role)))
        gate().check(frame, platform, None, 5, ("uav3", "uav2"))
        assert sender_of(frame.extension) == Sender(platform, expected, "anna", ("uav3", "uav2"))


def test_a_denial_names_the_user_with_its_role() -> None:
    frame = question(extension=with_caller(b"", Caller("anna", Role.OBSERVER)))
    with pytest.raises(Denied, match=r"^cmd/goto: anna@gcs \(observer\) may not call it; expected"):
        gate().check(frame, "gcs", "cmd/goto")


def test_refusal_has_role_of_its_sender_on_roster() -> None:
    one = gate()
    known = one.denied("uav2", Verb.CALL, "cmd/abort", "no", "anna", ("uav3",))
    assert (known.platform, known.role, known.path) == ("uav2", "node", "cmd/abort")
    assert (known.caller, known.via, known.count) == ("anna", ("uav3",), 1)
    assert one.denied("10.0.0.9", "connect", "", "no").role == UNKNOWN


def test_another_roster_changes_role_of_sender() -> None:
    one = gate()
    one.check(question(), "gcs", "cmd/goto")
    one.set_roles({"gcs": Role.OBSERVER, "uav2": Role.OPERATOR})
    with pytest.raises(Denied, match="observer@gcs"):
        one.check(question(), "gcs", "cmd/goto")
    one.check(question(), "uav2", "cmd/goto")


def test_other_units_applications_have_platform_rights() -> None:
    members = (RosterMember("uav2", b"", b"", "node", 1),)
    own = AccessFilter("uav2", Roster(1, members, revoked=()).roles(), Access())
    frame = question()
    own.check(frame, "uav2", "config/speed")
    assert sender_of(frame.extension) == Sender("uav2", Role.MAINTAINER)
    guest = question(extension=with_caller(b"", Caller("anna", Role.OBSERVER)))
    with pytest.raises(Denied, match="anna@uav2"):
        own.check(guest, "uav2", "config/speed")
