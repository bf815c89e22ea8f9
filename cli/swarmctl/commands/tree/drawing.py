"""The resource tree as lines of text."""

from collections.abc import Iterable, Iterator

from swarmware.model import names
from swarmware.model.resource import Kind
from swarmware.types.tree import Quality, TreeEntry


class _Node:
    def __init__(self) -> None:
        self.children: dict[str, _Node] = {}
        self.entry: TreeEntry | None = None


def tree(entries: Iterable[TreeEntry]) -> list[str]:
    """A line for each resource, below its branch."""
    root = _Node()
    for entry in entries:
        node = root
        for part in entry.path.strip("/").split("/"):
            node = node.children.setdefault(part, _Node())
        node.entry = entry
    return list(_lines(root, ""))


def _lines(node: _Node, indent: str) -> Iterator[str]:
    children = sorted(node.children.items(), key=lambda item: names.natural(item[0]))
    for index, (name, child) in enumerate(children):
        last = index == len(children) - 1
        yield f"{indent}{'└── ' if last else '├── '}{name}{_about(child.entry)}"
        yield from _lines(child, indent + ("    " if last else "│   "))


def _about(entry: TreeEntry | None) -> str:
    if entry is None or entry.kind is Kind.BRANCH:
        return f"  {entry.description}" if entry is not None and entry.description else ""
    unit = f" {entry.unit}" if entry.unit else ""
    rate = f" {entry.rate_hz:g} Hz" if entry.rate_hz else ""
    quality = "" if entry.quality is Quality.NONE else f" [{entry.quality}]"
    return f"  {entry.kind} {entry.type}{unit}{rate}{quality}"
