"""The record of changes and the rules of notifications, as commands."""

import io
from collections.abc import Set
from typing import Any

import click
import pytest
from tests.unit.cli.session import GAIN, LIST, ScriptedSession, listing
from tests.unit.cli.session import value as tree_value

from swarmctl.commands.tree.change_log import print_log
from swarmctl.commands.tree.listing import list_resources
from swarmctl.commands.tree.rules import set_rule
from swarmctl.resources.undoing import undo_resource
from swarmctl.session.each_node import at_each
from swarmware.errors import InvalidInput, NotFound, Partial, SwarmError
from swarmware.model.resource import Kind
from swarmware.types import registry
from swarmware.types.channel import ChannelLimit, ChannelLimits, ChannelSettings
from swarmware.types.tree import (
    LoggedChange,
    Quality,
    Rule,
    TreeChange,
    TreeEntry,
    TreeListing,
    TreeLog,
    TreeRule,
    TreeRules,
    TreeSetDone,
    TreeUndo,
    TreeValue,
)


@pytest.fixture(autouse=True)
def no_terminal(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("SWARM_CONFIG", str(tmp_path))


async def test_record_of_changes_shows_values_requesters_and_refusals() -> None:
    found = TreeLog(
        "uav1",
        (
            LoggedChange(
                1_700_000_000_000_000_000, TreeChange(GAIN, "observer@uav2", "[4.0]", "", "not yours")
            ),
            LoggedChange(1_600_000_000_000_000_000, TreeChange(GAIN, "operator@gcs", "", "[4.0]")),
            LoggedChange(1_500_000_000_000_000_000, TreeChange("/uav1/cmd/goto", "x", '{"a":1}', '[1,"b"]')),
        ),
        7,
    )
    more: dict[str, Any] = {"by": "", "since": "", "refused": False, "count": 3}
    session = ScriptedSession({"/uav1/sys/tree/log": found}, node="uav1")
    await print_log(session, "**", **more)
    lines = session.stdout.getvalue().splitlines()
    assert lines[1].split(maxsplit=4) == [
        "2023-11-14T22:13:20.000Z", "config/gain", "4", "refused:", "not yours  observer@uav2",
    ]  # fmt: skip
    assert lines[2].split()[1:] == ["config/gain", "-", "4", "operator@gcs"]
    assert "7 older changes" in session.stderr.getvalue()
    session = ScriptedSession({"/uav1/sys/tree/log": found}, node="uav1", output="json")
    await print_log(session, "**", **more)
    shown = session.document["changes"]
    assert [(one["before"], one["after"], one["refused"]) for one in shown] == [
        (4.0, None, "not yours"),
        (None, 4.0, ""),
        ({"a": 1}, [1, "b"], ""),
    ]
    with pytest.raises(InvalidInput, match="time '5'"):
        await print_log(session, "**", **more | {"since": "5"})


def limits(rules: tuple[ChannelLimit, ...]) -> TreeValue:
    data = registry.encode(ChannelLimits(rules))
    return TreeValue("/uav1/net/limits", "ChannelLimits", data, 1, 1, 1, 0.5, Quality.LIVE)


async def test_rule_is_shown_with_its_limits() -> None:
    asked: list[TreeRule] = []

    class Owner(ScriptedSession):
        async def ask(self, path: str, value: Any, reply: type[Any], **rest: Any) -> Any:
            if isinstance(value, TreeRule):
                asked.append(value)
            return await super().ask(path, value, reply, **rest)

    beacon = TreeEntry(
        "/uav1/power/battery", Kind.BOARD, "Battery", link="tick", rule=Rule("power/*", 0.5, 2.0)
    )
    answers = {
        "/uav1/sys/tree/rule": TreeRules("uav1", (Rule("power/*", 0.5, 2.0),)),
        "/uav1/sys/tree/list": TreeListing((beacon,)),
        LIST: TreeListing((beacon,)),
        "/uav1/sys/tree/get /uav1/net/limits": limits((ChannelLimit("power/*", ChannelSettings(1.0)),)),
    }
    none: dict[str, Any] = {
        "deadband": None,
        "min_interval": "",
        "max_interval": "",
        "reset": False,
        "yes": False,
    }
    session = Owner(answers, node="uav1")
    await set_rule(session, "power/*", **none | {"deadband": 0.5, "min_interval": "2s"})
    assert asked == [TreeRule("power/*", 0.5, 2.0)]
    assert session.stdout.getvalue().splitlines()[1].split() == ["power/*", "0.5", "2", "-"]
    assert "power/battery: in the beacon, which keeps the min interval only" in session.stderr.getvalue()
    assert "power/battery: `traffic set --rate` decides the rate" in session.stderr.getvalue()
    with pytest.raises(click.UsageError, match="barriers of a mission wait"):
        await set_rule(session, "**", **none | {"min_interval": "2s"})
    assert len(asked) == 1
    session = Owner(answers, node="uav1", output="json")
    await set_rule(session, "**", **none)
    assert not asked[-1].changes
    assert session.document["rules"] == [
        {"pattern": "power/*", "deadband": 0.5, "min_interval_s": 2.0, "max_interval_s": 0.0}
    ]
    session = Owner(answers, node="uav1", output="wide")
    await list_resources(session, "power/*")
    assert "±0.5 ≥2s" in session.stdout.getvalue()


class Swarm(ScriptedSession):
    """Three nodes: the nodes in `having` have the setting, the nodes in `changed` a change of it to undo."""

    def __init__(self, having: Set[str], changed: Set[str], node: str) -> None:
        super().__init__({}, node=node)
        self.having, self.changed = having, changed

    async def platforms(self) -> list[str]:
        return ["gcs", "uav1", "uav2"]

    async def reach(self, platform: str) -> None:
        assert platform in await self.platforms()

    async def ask(self, path: str, value: Any, reply: type[Any], **rest: Any) -> Any:
        if reply is TreeListing:
            platform = value.pattern.split("/")[1]
            return listing(*([value.pattern] if platform in self.having else ()))
        platform = value.path.split("/")[1]
        if platform not in (self.changed if isinstance(value, TreeUndo) else self.having):
            raise NotFound(f"{value.path}: was not changed; nothing to undo")
        found = tree_value(value.path, 1.5)
        if reply is TreeSetDone:
            return TreeSetDone(found.path, 2, found.type, found.data)
        return found


@pytest.mark.parametrize(
    ("having", "changed", "node", "undone", "error"),
    [
        ({"uav1", "uav2"}, {"uav1", "uav2"}, "*", 2, None),
        ({"uav1", "uav2"}, {"uav1"}, "*", 1, Partial),  # one was not changed
        ({"uav1"}, {"uav1"}, "*", 1, None),
        ({"uav1"}, {"uav1"}, "uav1,gcs", 1, Partial),  # the operator has named one without it
        ({"uav1"}, {"uav1"}, "gcs,uav*", 1, Partial),
        (set(), set(), "*", 0, NotFound),
    ],
)
async def test_undo_at_pattern_skips_nodes_without_setting(
    having: Set[str], changed: Set[str], node: str, undone: int, error: type[SwarmError] | None
) -> None:
    session = Swarm(having, changed, node)
    if error is None:
        await at_each(session, undo_resource, "config/gain", yes=True)
        left_out = ", ".join(name for name in await session.platforms() if name not in having)
        assert f"left out, without such a resource: {left_out}" in session.stderr.getvalue()
    else:
        with pytest.raises(error):
            await at_each(session, undo_resource, "config/gain", yes=True)
    assert session.stdout.getvalue().count("config/gain = 1.5") == undone


async def test_joint_change_looks_resource_up_once() -> None:
    listed: list[str] = []

    class Asking(Swarm):
        async def ask(self, path: str, value: Any, reply: type[Any], **rest: Any) -> Any:
            if reply is TreeListing:
                listed.append(value.pattern)
            return await super().ask(path, value, reply, **rest)

    both = {"uav1", "uav2"}
    session = Asking(both, both, "uav*")
    await at_each(session, undo_resource, "config/gain", yes=False)  # no effect to confirm in the template
    assert sorted(listed) == ["/uav1/config/gain", "/uav2/config/gain"]
