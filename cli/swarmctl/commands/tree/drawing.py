"""The resource tree as lines of text."""

from collections.abc import Iterable, Iterator

from swarmctl.terminal.quantities import spoken
from swarmware.model import names
from swarmware.model.resource import Kind
from swarmware.types.tree import Quality, Rule, TreeEntry
from swarmware.types.units import unit_suffix


class _Node:
    def __init__(self) -> None:
        self.children: dict[str, _Node] = {}
        self.entry: TreeEntry | None = None


def tree(entries: Iterable[TreeEntry], *, live: bool = False) -> list[str]:
    """A line for each resource below its branch, with age and measured rate of its value if `live`."""
    root = _Node()
    for entry in entries:
        node = root
        for part in entry.path.strip("/").split("/"):
            node = node.children.setdefault(part, _Node())
        node.entry = entry
    return list(_lines(root, "", live))


def _lines(node: _Node, indent: str, live: bool) -> Iterator[str]:
    children = sorted(node.children.items(), key=lambda item: names.natural(item[0]))
    for index, (name, child) in enumerate(children):
        last = index == len(children) - 1
        yield f"{indent}{'└── ' if last else '├── '}{name}{_about(child.entry, live)}"
        yield from _lines(child, indent + ("    " if last else "│   "), live)


def _about(entry: TreeEntry | None, live: bool) -> str:
    if entry is None or entry.kind is Kind.BRANCH:
        return f"  {entry.description}" if entry is not None and entry.description else ""
    unit = unit_suffix(entry.unit)
    rate = f" {entry.rate_hz:g} Hz" if entry.rate_hz else ""
    quality = "" if entry.quality is Quality.NONE else f" [{entry.quality}]"
    rule = "" if entry.rule is None else f" rule {rule_text(entry.rule)}"
    if live:
        hz = "" if entry.measured_hz is None else f" {entry.measured_hz:.3g} Hz"
        age = "" if entry.age_s is None else f" {spoken(max(entry.age_s, 0.0))}"
        return f"  {entry.type}{unit}{hz}{age}{quality}{rule}"
    return f"  {entry.kind} {entry.type}{unit}{rate}{quality}{rule}"


def rule_text(rule: Rule | None) -> str | None:
    """A rule in a line such as `±0.5 ≥2s ≤30s`, or None without a rule."""
    if rule is None:
        return None
    parts = [
        f"±{rule.deadband:g}" if rule.deadband else "",
        f"≥{rule.min_interval_s:g}s" if rule.min_interval_s else "",
        f"≤{rule.max_interval_s:g}s" if rule.max_interval_s else "",
    ]
    return " ".join(filter(None, parts)) or "any change"
