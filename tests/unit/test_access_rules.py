"""`acl.toml` is read again while the node runs; an invalid file never replaces the rules in force."""

import logging
import os
from pathlib import Path

import pytest

from swarmware.errors import ConfigError, Denied
from swarmware.model.access import Role, Sender, Verb
from swarmware.model.access_rules import AccessRules
from swarmware.model.acl import FILE
from swarmware.transport.delivery.sender import Caller
from swarmware.transport.messaging.callers import Callers
from swarmware.transport.security.denials import REPORT_NS
from swarmware.types.net import Denial

NODE = Sender("uav2", Role.NODE)
OTHER = 65534
FREE = '[[rule]]\nverb = "call"\npath = "cmd/**"\nrole = "node"\n'
STRICT = '[[rule]]\nverb = "call"\npath = "cmd/**"\nrole = "maintainer"\n'
INVALID = '[[rule]]\nverb = "call"\npath = "cmd/**"\nrole = "admiral"\n'


class File:
    """The file of access rules, each version with another time of change."""

    def __init__(self, folder: Path, text: str | None) -> None:
        self.path = folder / FILE
        self._changes = 0
        if text is not None:
            self.write(text)

    def write(self, text: str) -> None:
        self._changes += 1
        self.path.write_text(text)
        os.utime(self.path, ns=(self._changes, self._changes))


def started(folder: Path, text: str | None) -> tuple[File, AccessRules]:
    file, rules = File(folder, text), AccessRules(folder)
    rules.check()
    return file, rules


def may_command(rules: AccessRules) -> bool:
    return rules.access.permits(NODE, Verb.CALL, "cmd/goto")


def test_changed_file_holds_after_two_polls(tmp_path: Path) -> None:
    file, rules = started(tmp_path, FREE)
    access, version = rules.access, rules.version
    assert may_command(rules)
    file.write(STRICT)
    rules.poll()
    assert may_command(rules), "perhaps its writer has not finished"
    rules.poll()
    assert not may_command(rules)
    assert rules.access is access, "daemons hold it"
    assert rules.version == version + 1


def test_incompletely_written_file_is_not_read(tmp_path: Path) -> None:
    file, rules = started(tmp_path, STRICT)
    for text in ("", "[[ru", '[[rule]]\nverb = "call"', FREE):
        file.write(text)
        rules.poll()
        assert (rules.problem, may_command(rules)) == ("", False)
    rules.poll()
    assert may_command(rules)


@pytest.mark.parametrize("text", [INVALID, "[[operator", "rule = 3", FREE + "\nunknown = 1\n", "\x00"])
def test_invalid_file_keeps_former_rules(tmp_path: Path, text: str, caplog: pytest.LogCaptureFixture) -> None:
    file, rules = started(tmp_path, STRICT)
    file.write(text)
    with caplog.at_level(logging.INFO):
        for _ in range(5):
            rules.poll()
    assert not may_command(rules)
    assert FILE in rules.problem
    assert rules.problem.endswith("; the former rules stay in force")
    assert [record.getMessage() for record in caplog.records] == [rules.problem]
    file.write(FREE)
    rules.poll()
    rules.poll()
    assert (rules.problem, may_command(rules)) == ("", True)


def test_removed_file_leaves_former_rules_in_force(tmp_path: Path) -> None:
    file, rules = started(tmp_path, FREE)
    file.path.unlink()
    rules.poll()
    rules.poll()
    assert may_command(rules)
    assert "the file is missing; the former rules stay in force" in rules.problem
    file.write(FREE)
    rules.poll()
    rules.poll()
    assert rules.problem == ""


def test_a_file_may_come_after_the_start(tmp_path: Path) -> None:
    file, rules = started(tmp_path, None)
    assert not may_command(rules)
    file.write(FREE)
    rules.poll()
    rules.poll()
    assert may_command(rules)


def test_service_starts_only_with_valid_file(tmp_path: Path) -> None:
    file, rules = File(tmp_path, INVALID), AccessRules(tmp_path)
    with pytest.raises(ConfigError, match=r"acl.toml: line 4: key rule\[0\].role"):
        rules.check()
    assert rules.operators == ()
    file.write(FREE)
    rules.poll()
    rules.poll()
    rules.check()
    file.write(INVALID)
    rules.poll()
    rules.poll()
    rules.check()  # a restart of a service within the process: the former rules are in force


def test_user_gets_changed_role_without_reconnecting(tmp_path: Path) -> None:
    file = File(tmp_path, '[[operator]]\nuser = "nobody"\nname = "anna"\nrole = "operator"\n')
    rules = AccessRules(tmp_path)
    callers = Callers(rules, "uav1", 4242)
    assert callers.caller(OTHER) == Caller("anna", Role.OPERATOR)
    file.write('[[operator]]\nuser = "nobody"\nname = "anna"\nrole = "observer"\n')
    rules.poll()
    rules.poll()
    assert callers.caller(OTHER) == Caller("anna", Role.OBSERVER)


async def test_denied_users_are_counted_and_logged_periodically(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    callers = Callers(AccessRules(tmp_path), "uav1", 4242)
    reports, second = list[Denial](), list[Denial]()
    callers.add_listener(reports.append)
    callers.add_listener(second.append)
    for step in range(1000):
        with pytest.raises(Denied):
            callers.check(Caller("bob", Role.OBSERVER), "cmd/goto", step * REPORT_NS // 500)
    assert callers.denied == 1000
    assert [(one.platform, one.caller, one.path, one.count) for one in reports] == [
        ("uav1", "bob", "cmd/goto", 1),
        ("uav1", "bob", "cmd/goto", 500),
    ]
    assert second == []
    lines = [record.getMessage() for record in caplog.records]
    assert len(lines) == 2
    assert "bob@uav1 (observer) may not call it" in lines[0]
    assert lines[1].endswith("(500 since the last message)")
    callers.close()
