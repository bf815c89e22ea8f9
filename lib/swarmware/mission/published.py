"""The block types of the published plug-ins for ROS, and their counterparts here: one table (S4.20)."""

import re
from collections.abc import Callable
from typing import Any, Final

import msgspec

from swarmware.mission.catalogue import BlockName


class PublishedType(msgspec.Struct, frozen=True):
    """A block type of published BDL."""

    name: str
    block: BlockName | None
    """Type that plays it here, or None without a counterpart."""
    keys: tuple[tuple[str, str], ...] = ()
    """Its keys, each with our parameter; of several for one parameter the first that is not empty counts."""
    ignored: tuple[str, ...] = ()
    """Keys without a counterpart; the block is played without them."""
    preset: dict[str, Any] = {}
    """Parameters that no key gives."""
    instead: str = ""
    """Advice to the author of a mission with a type without a counterpart."""


_NODE: Final = (("nodename", "service"), ("node", "service"))
_PROCESS: Final = ("package", "commandline_args")
_LONG: Final = {"answer_s": 300.0}
"""An action moves a vehicle; it answers when it has ended."""
_STARTED: Final = "expected a StartModule for each service that it starts"
_ALWAYS_LOGGED: Final = "the logger records all resources from the start of the node; leave the block out"

PUBLISHED: Final = {
    one.name: one
    for one in (
        PublishedType("CallService", BlockName.REQUEST, (("servicename", "path"), ("args", "args"))),
        PublishedType(
            "CallServiceROS1", BlockName.REQUEST, (("name", "path"), ("data", "args")), ("commandline_args",)
        ),
        PublishedType(
            "CallServiceROS2",
            BlockName.REQUEST,
            (("address", "path"), ("data", "args")),
            ("svctype", "commandline_args"),
        ),
        PublishedType(
            "CallAction", BlockName.REQUEST, (("actionname", "path"), ("args", "args")), preset=_LONG
        ),
        PublishedType("WaitForActiveTopic", BlockName.WAIT_FOR_RESOURCE, (("topic", "path"),)),
        PublishedType(
            "WaitForActiveTopicROS1", BlockName.WAIT_FOR_RESOURCE, (("name", "path"),), ("commandline_args",)
        ),
        PublishedType(
            "WaitForActiveTopicROS2", BlockName.WAIT_FOR_RESOURCE, (("name", "path"),), ("commandline_args",)
        ),
        PublishedType("StartNode", BlockName.START_MODULE, _NODE, _PROCESS),
        PublishedType("StartNodeROS2", BlockName.START_MODULE, _NODE, _PROCESS),
        PublishedType("LaunchROS", None, instead=_STARTED),
        PublishedType("LaunchROS1", None, instead=_STARTED),
        PublishedType("StartRoscore", None, instead="a node has its broker; leave the block out"),
        PublishedType("StartROS1Bridge", None, instead="there is no bridge to ROS 1"),
        PublishedType("StartLogging", None, instead=_ALWAYS_LOGGED),
        PublishedType("StopLogging", None, instead=_ALWAYS_LOGGED),
    )
}
"""The published block types by name."""


_WORD_END: Final = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


def _path(value: str) -> Any:
    """A path for a name of ROS: `/log/startAll` is `log/start_all`."""
    # here a leading slash names another platform
    return _WORD_END.sub("_", value.removeprefix("/")).lower()


def _arguments(value: str) -> Any:
    """The arguments of a call: JSON, or values with commas between them."""
    if not value.strip():
        return []
    try:
        found = msgspec.json.decode(value)
    except msgspec.DecodeError:
        found = None
    if isinstance(found, dict | list):
        return found
    return [_plain(word.strip()) for word in value.split(",")]


def _plain(word: str) -> Any:
    try:
        return msgspec.json.decode(word)
    except msgspec.DecodeError:
        return word


_CONVERT: Final[dict[str, Callable[[str], Any]]] = {"path": _path, "args": _arguments}


def converted(published: PublishedType, body: dict[str, Any]) -> dict[str, tuple[str, Any]]:
    """Our parameters of a published block, each with the key that gives it and its value."""
    found: dict[str, tuple[str, Any]] = {name: ("", value) for name, value in published.preset.items()}
    for key, name in published.keys:
        if key not in body or (name in found and body[key] == ""):
            continue
        if name in found and found[name][1] != "":
            continue  # an earlier key has given the parameter
        value = body[key]
        found[name] = (key, _CONVERT[name](value) if isinstance(value, str) and name in _CONVERT else value)
    return found
