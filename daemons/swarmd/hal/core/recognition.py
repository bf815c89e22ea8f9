"""Recognition of devices: which driver serves a device file that appears (S4.30)."""

from collections.abc import Iterable
from fnmatch import fnmatchcase
from typing import Generic, Protocol, TypeVar

import msgspec


class DeviceRule(Protocol):
    """What the recognition needs of a rule."""

    @property
    def path(self) -> str: ...
    @property
    def usb(self) -> str: ...


R = TypeVar("R", bound=DeviceRule)


class DeviceNode(msgspec.Struct, frozen=True):
    """A device file of the kernel."""

    path: str
    usb: str = ""
    """`vendor:product` in hexadecimal digits; empty: not on USB."""


class Recognised(msgspec.Struct, Generic[R], frozen=True):
    """A device that a rule recognises."""

    node: DeviceNode
    rule: R


class Recognition(Generic[R]):
    """Recognises each device once; the first rule that fits decides."""

    def __init__(self, rules: tuple[R, ...]) -> None:
        self._rules = rules
        self._known: set[str] = set()

    def on_nodes(self, nodes: Iterable[DeviceNode]) -> list[Recognised[R]]:
        """Takes the device files that there are; returns those that are recognised for the first time.

        The driver of a device that was unplugged waits for it, and needs no second start.
        """
        found = []
        for node in sorted(nodes, key=lambda node: node.path):
            if node.path in self._known:
                continue
            rule = next((rule for rule in self._rules if fits(rule, node)), None)
            if rule is not None:
                self._known.add(node.path)
                found.append(Recognised(node, rule))
        return found


def fits(rule: DeviceRule, node: DeviceNode) -> bool:
    """Whether a rule recognises a device file."""
    return fnmatchcase(node.path, rule.path) and (not rule.usb or rule.usb.lower() == node.usb)
