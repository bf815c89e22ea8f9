"""Every address that a node serves has a stated right, and no frame reaches a handler past the check."""

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.architecture.sources import ROOT, ROOTS, nodes

from swarmware.model import template
from swarmware.model.access import Access, Role, Sender, Verb
from swarmware.model.acl import load_acl
from swarmware.model.paths import APPLICATIONS, is_reserved_path
from swarmware.model.resource import Kind
from swarmware.service.installed import installed

SOURCES = [file for part in ROOTS for file in sorted((ROOT / part).rglob("*.py"))]

OBSERVER, NODE, OPERATOR, MAINTAINER = Role
SERVED = {
    # what only shows something
    "sys/broker/links": OBSERVER,
    "sys/broker/outages": OBSERVER,
    "sys/broker/routes": OBSERVER,
    "sys/broker/traffic": OBSERVER,
    "sys/guard/status": OBSERVER,
    "sys/health/faults": OBSERVER,
    "sys/health/state": OBSERVER,
    "sys/log/stats": OBSERVER,
    "sys/mission/history": OBSERVER,
    "sys/mission/ls": OBSERVER,
    "sys/mission/queue": OBSERVER,
    "sys/mission/run": OBSERVER,
    "sys/mission/status": OBSERVER,
    "sys/node/config": OBSERVER,
    "sys/node/info": OBSERVER,
    "sys/register/apps": OBSERVER,
    "sys/time/functions": OBSERVER,
    "sys/tree/channels": OBSERVER,
    "sys/tree/get": OBSERVER,
    "sys/tree/history": OBSERVER,
    "sys/tree/list": OBSERVER,
    "sys/tree/placement": OBSERVER,
    "sys/tree/log": OBSERVER,
    "sys/tree/structure": OBSERVER,
    "sys/tree/subscribe": OBSERVER,
    "sys/tree/type": OBSERVER,
    "sys/video/ls": OBSERVER,
    # the tree judges the path in the request, too
    "sys/tree/notify": NODE,
    "sys/tree/reset": NODE,
    "sys/tree/rule": NODE,
    "sys/tree/set": NODE,
    "sys/tree/undo": NODE,
    # a platform that will send video asks for room
    "sys/video/open": NODE,
    # what flies, drives and decides; how data travels, also as video
    "cmd/abort": OPERATOR,
    "cmd/manual": OPERATOR,
    "cmd/mission": OPERATOR,
    "sys/broker/clear_channels": OPERATOR,
    "sys/broker/set_channel": OPERATOR,
    "sys/broker/undo_channel": OPERATOR,
    "sys/files/list": OPERATOR,
    "sys/files/offer": OPERATOR,
    "sys/files/read": OPERATOR,
    "sys/files/write": OPERATOR,
    "sys/health/clear": OPERATOR,
    "sys/health/register": OPERATOR,
    "sys/mission/abort": OPERATOR,
    "sys/mission/answer": OPERATOR,
    "sys/mission/prioritize": OPERATOR,
    "cmd/priority": OPERATOR,
    "sys/mission/drain": OPERATOR,
    "sys/mission/manoeuvre": OPERATOR,
    "sys/mission/plan": OPERATOR,
    "sys/mission/task": OPERATOR,
    "sys/vehicle/arm": OPERATOR,
    "sys/vehicle/calibrate": OPERATOR,
    "sys/vehicle/calibrate_sensor": OPERATOR,
    "sys/vehicle/drive": OPERATOR,
    "sys/vehicle/gains": OPERATOR,
    "sys/vehicle/kill": OPERATOR,
    "sys/video/rate": OPERATOR,
    "sys/video/rtp": OPERATOR,  # takes datagrams of its sessions alone, no calls
    "sys/video/start": OPERATOR,
    "sys/video/stop": OPERATOR,
    # what stops services, changes members
    "sys/broker/roster": MAINTAINER,
    "sys/register/forget": MAINTAINER,
    "sys/tree/denied": MAINTAINER,
    "sys/tree/forget": MAINTAINER,
    "sys/guard/restart": MAINTAINER,
    "sys/guard/start": MAINTAINER,
    "sys/guard/stop": MAINTAINER,
    "sys/sim/switch": MAINTAINER,
}
"""Lowest role for each address that a daemon serves, or a template has, by the default rules."""

DOORS = {
    "serve_messages": {"lib/swarmware/module/module.py"},
    "serve_requests": {"lib/swarmware/module/module.py"},
    "serve_datagrams": {"lib/swarmware/module/module.py"},
    "_message_handlers": {"lib/swarmware/transport/messaging/endpoint.py"},
    "_request_handlers": {"lib/swarmware/transport/messaging/endpoint.py"},
    "_datagram_handlers": {"lib/swarmware/transport/messaging/endpoint.py"},
    "deliver": {"daemons/swarmd/broker/exchange/frame_delivery.py"},
    "with_sender": {
        "daemons/swarmd/broker/core/membership/access_filter.py",
        "lib/swarmware/transport/messaging/endpoint.py",
    },
}
"""Files that may use the ways to a handler, and the statement of who sent a frame."""


def _served(file: Path) -> Iterator[str]:
    """Addresses in calls of `serve`, `inbox` and `take_datagrams`."""
    module = None
    for node in nodes(file):
        if not isinstance(node, ast.Call) or len(node.args) < 2:
            continue
        function = node.func
        name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
        if name not in ("serve", "inbox", "take_datagrams"):
            continue
        match node.args[0]:
            case ast.Constant(value=str(path)):
                yield path
            case ast.Name(id=constant) if constant.isupper():
                parts = file.relative_to(ROOT).with_suffix("").parts[1:]
                module = module or importlib.import_module(".".join(parts))
                yield getattr(module, constant)
            case ast.Name(id="local" | "data_id"):
                pass  # the two layers below `Module.serve` and `Module.inbox`
            case other:
                raise AssertionError(f"{file}:{node.lineno}: address {ast.unparse(other)}: expected a text")


def _commands() -> Iterator[str]:
    folder = ROOT / "share" / "swarm" / "templates"
    for name in template.names_in(folder):
        for resource in template.load(name, folder).resources:
            if resource.kind is Kind.COMMAND:
                yield resource.path


def test_the_rights_of_every_served_address_are_stated() -> None:
    served = {path for file in SOURCES for path in _served(file)} | set(_commands())
    assert len(served) > 30
    assert served == set(SERVED)


def test_names_of_daemons_and_their_branches_are_reserved() -> None:
    daemons = {name for name, point in installed().items() if point.value.startswith("swarmd.")}
    assert daemons == APPLICATIONS
    served = {path for file in SOURCES if "daemons" in file.parts for path in _served(file)}
    assert [path for path in sorted(served) if "/" in path and not is_reserved_path(path)] == []


@pytest.mark.parametrize("rules", ["default", "shipped"])
def test_served_address_has_role_and_refuses_below_it(rules: str) -> None:
    access = Access() if rules == "default" else Access(load_acl(ROOT / "etc" / "swarm").rule)
    found = {path: access.needed(Verb.CALL, path) for path in SERVED}
    assert found == SERVED
    for path, needed in SERVED.items():
        for role in Role:
            assert access.permits(Sender("gcs", role), Verb.CALL, path) is (role >= needed)


def test_observer_sets_nothing_and_calls_no_application() -> None:
    access = Access()
    observer = Sender("gcs", Role.OBSERVER)
    for path in ("config/planner/speed_m_s", "nav/home", "plan/share", "cmd/my_name", "a", "sysx/tree/get"):
        assert not access.permits(observer, Verb.CALL, path), path
        assert not access.permits(observer, Verb.SET, path), path


def _users(name: str) -> set[str]:
    found = set()
    for file in SOURCES:
        for node in nodes(file):
            match node:
                case ast.Attribute(attr=used) | ast.Name(id=used) | ast.alias(name=used) if used == name:
                    found.add(str(file.relative_to(ROOT)))
    return found


@pytest.mark.parametrize("name", DOORS)
def test_handlers_are_reached_only_through_the_checking_door(name: str) -> None:
    assert _users(name) == DOORS[name]
