"""Recognition of devices, which selects the driver for a device file that appears (S4.30)."""

from collections.abc import Iterable
from fnmatch import fnmatchcase
from typing import Generic, Protocol, TypeVar

import msgspec


class DeviceRule(Protocol):
    """The part of a rule by which devices are recognised."""

    @property
    def path(self) -> str: ...
    @property
    def usb(self) -> str: ...


R = TypeVar("R", bound=DeviceRule)


class DeviceNode(msgspec.Struct, frozen=True):
    """A device file of the kernel, with its USB identifiers."""

    path: str
    usb: str = ""
    """Identifiers `vendor:product` in hexadecimal digits, or "" for a device that is not on USB."""


class Recognised(msgspec.Struct, Generic[R], frozen=True):
    """A recognised device, and the rule that matched."""

    node: DeviceNode
    rule: R


class Recognition(Generic[R]):
    """Recognises each device once, by the first matching rule."""

    def __init__(self, rules: tuple[R, ...]) -> None:
        self._rules = rules
        self._known: set[str] = set()

    def on_nodes(self, nodes: Iterable[DeviceNode]) -> list[Recognised[R]]:
        """Takes the present device files; returns the files that are recognised for the first time.

        The driver of an unplugged device waits for its return, and needs no second start.
        """
        found = []
        # sorted, so that equal devices get their drivers in the same order at each start
        for node in sorted(nodes, key=lambda node: node.path):
            if node.path in self._known:
                continue
            rule = next((rule for rule in self._rules if fits(rule, node)), None)
            if rule is not None:
                self._known.add(node.path)
                found.append(Recognised(node, rule))
        return found


def fits(rule: DeviceRule, node: DeviceNode) -> bool:
    """True if a rule matches a device file."""
    return fnmatchcase(node.path, rule.path) and (not rule.usb or rule.usb.lower() == node.usb)
