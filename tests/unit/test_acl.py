"""The file of access rules: the shipped one is the default, and each error names place and expectation."""

import grp
import os
import pwd
from pathlib import Path

import pytest

from swarmware.errors import ConfigError, Denied
from swarmware.model.access import DEFAULT, Access, Role, Sender, Verb
from swarmware.model.access_rules import AccessRules
from swarmware.model.acl import FILE, AclConfig, OperatorEntry, load_acl
from swarmware.transport.delivery.sender import Caller
from swarmware.transport.messaging.callers import Callers, caller_of_user

SHIPPED = Path(__file__).parents[2] / "etc/swarm"
NOBODY = pwd.getpwnam("nobody")
OTHER = NOBODY.pw_uid


def write(folder: Path, text: str) -> Path:
    (folder / FILE).write_text(text)
    return folder


def test_the_shipped_file_is_the_default(tmp_path: Path) -> None:
    assert load_acl(SHIPPED) == AclConfig() == load_acl(tmp_path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[[rule]]\nverb = "get"\npath = "**"\nrole = "admiral"', r"acl.toml.*role.*'admiral'"),
        ('[[rule]]\nverb = "eat"\npath = "**"\nrole = "node"', r"acl.toml.*verb.*'eat'"),
        ('[[rule]]\nverb = "get"\npath = "a b"\nrole = "node"', r"acl.toml.*a b"),
        ('[[rule]]\nverb = "get"\npath = "**"\nrole = "node"\nwhen = 1', r"acl.toml.*when"),
        ('[[rule]]\nverb = "get"\nrole = "node"', r"acl.toml.*path"),
        ("[[operator]]\n", "either a user or a group"),
        ('[[operator]]\nuser = "a"\ngroup = "b"', "either a user or a group"),
        ('[[operator]]\ngroup = "b"\nname = "anna"', "expected a user"),
        ('[[operator]]\nuser = "a"\nname = "Anna Schmidt"', "Anna Schmidt"),
        ("rule = 3", "rule"),
        ("[[rule", "acl.toml"),
    ],
)
def test_file_error_names_place_and_expectation(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_acl(write(tmp_path, text))


def test_first_matching_rule_of_file_decides(tmp_path: Path) -> None:
    text = (
        '[[rule]]\nverb = "call"\npath = "cmd/abort"\nrole = "node"\n'
        '[[rule]]\nverb = "call"\npath = "cmd/**"\nrole = "maintainer"\n'
    )
    acl = load_acl(write(tmp_path, text))
    assert acl.operator == AclConfig().operator
    access = Access(acl.rule)
    node = Sender("uav2", Role.NODE)
    access.check(node, Verb.CALL, "cmd/abort")
    for verb, path in [(Verb.CALL, "cmd/goto"), (Verb.GET, "nav/pose"), (Verb.CALL, "sys/tree/get")]:
        with pytest.raises(Denied, match="expected role maintainer"):
            access.check(node, verb, path)


def group_of_nobody() -> str:

    return grp.getgrgid(NOBODY.pw_gid).gr_name


@pytest.mark.parametrize(
    ("operators", "caller"),
    [
        ((), Caller("nobody", Role.OBSERVER)),
        ((OperatorEntry(group="no such group"),), Caller("nobody", Role.OBSERVER)),
        ((OperatorEntry(user="nobody", name="anna"),), Caller("anna", Role.OPERATOR)),
        ((OperatorEntry(user="nobody", role="maintainer"),), Caller("nobody", Role.MAINTAINER)),
        ((OperatorEntry(group=group_of_nobody(), role="node"),), Caller("nobody", Role.NODE)),
        (
            (
                OperatorEntry(group=group_of_nobody(), role="maintainer"),
                OperatorEntry(user="nobody", role="observer"),
            ),
            Caller("nobody", Role.OBSERVER),
        ),
    ],
)
def test_user_has_own_then_groups_then_observer(operators: tuple[OperatorEntry, ...], caller: Caller) -> None:
    assert caller_of_user(OTHER, operators) == caller


def test_a_user_without_a_name_observes() -> None:
    assert caller_of_user(3_999_999_999, AclConfig().operator) == Caller("_3999999999", Role.OBSERVER)


def test_root_and_node_user_have_platform_rights(tmp_path: Path) -> None:
    callers = Callers(AccessRules(tmp_path), "uav1", 4242)
    assert [callers.caller(uid) for uid in (0, 4242, os.geteuid())] == [None, None, None]
    assert callers.caller(OTHER) == Caller("nobody", Role.OBSERVER)


async def test_with_an_invalid_file_other_users_observe(tmp_path: Path) -> None:
    callers = Callers(AccessRules(write(tmp_path, "[[operator")), "uav1", 4242)
    caller = callers.caller(OTHER)
    assert caller == Caller("nobody", Role.OBSERVER)
    assert caller is not None
    callers.check(caller, "sys/tree/get", 0)
    with pytest.raises(Denied, match=r"nobody@uav1 \(observer\) may not call it"):
        callers.check(caller, "cmd/goto", 0)


def test_the_default_rules_are_valid() -> None:
    assert {rule.verb for rule in DEFAULT} == set(Verb)
