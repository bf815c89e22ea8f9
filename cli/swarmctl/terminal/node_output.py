"""Results of one command at several nodes: kept for each node, then printed as one."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import msgspec

from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Cell, Column
from swarmware.errors import Partial, SwarmError
from swarmware.model.visible import visible

NODE: Final = Column("NODE")
ERROR: Final = Column("ERROR")


class NodeResult(msgspec.Struct, frozen=True):
    """Result of a command at one node."""

    platform: str
    result: Any
    """Document of the command as for one node, or null if it failed or prints none."""
    error: str = ""
    """Reason of the failure, or "" without one."""
    exit_code: int = 0
    """As if the command had been called for this node alone."""


class NodeResults(msgspec.Struct, frozen=True):
    """Results of a command at each of the selected nodes."""

    nodes: list[NodeResult]


class ResultTable(msgspec.Struct, frozen=True):
    """A table that a command printed."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    title: str


class NodeOutput(Output):
    """Output of a command at one of several nodes: keeps results, passes on lines and messages."""

    def __init__(self, platform: str, shown: Output) -> None:
        super().__init__(shown.settings)
        self._platform = platform
        self._shown = shown
        self.results: list[ResultTable | str] = []
        self.empty: list[str] = []
        """Messages in the place of tables without rows."""
        self.result: msgspec.Struct | None = None

    @property
    def redraws(self) -> bool:
        """Never: several nodes share the terminal."""
        return False

    def named(self, text: str) -> str:
        """A text that names the node."""
        begins = text.startswith((f"{self._platform}:", f"/{self._platform}/"))
        return text if begins else f"{self._platform}: {text}"

    def say(self, text: str) -> None:
        """Print a message of this node."""
        self._shown.say(self.named(text))

    def detail(self, text: str) -> None:
        """Print a message of this node if --verbose is given."""
        self._shown.detail(self.named(text))

    def warn(self, text: str) -> None:
        """Print a warning of this node."""
        self._shown.warn(self.named(text))

    def now(self, *lines: str) -> None:
        """Print lines of a continuous result."""
        self._shown.now(*map(self.named, lines))

    def line(self, value: msgspec.Struct) -> None:
        """Print one item of a continuous result, which names its platform."""
        self._shown.line(value)

    def text(self, *lines: str) -> None:
        """Keep lines of a result that is text."""
        self.results.append("\n".join(map(visible, lines)))

    def verbatim(self, text: str) -> None:
        """Keep a result that is copied or read by programs."""
        self.results.append(text)

    def table(
        self,
        columns: Sequence[Column],
        rows: Sequence[Sequence[Cell]],
        title: str = "",
        *,
        empty: str = "nothing to list",
    ) -> None:
        """Keep a result that is a table; without rows keep the message `empty`."""
        if not rows:
            self.empty.append(empty)
            return
        self.results.append(ResultTable(tuple(columns), tuple(tuple(row) for row in rows), title))

    def document(self, value: msgspec.Struct) -> None:
        """Keep the result for programs."""
        self.result = value


def print_results(out: Output, outputs: Mapping[str, NodeOutput], errors: Mapping[str, SwarmError]) -> None:
    """Prints the results of all nodes: tables of the same columns as one, with the errors in their rows."""
    if out.settings.structured:
        out.document(
            NodeResults(
                [
                    NodeResult(name, one.result, str(errors[name]), errors[name].exit_code)
                    if name in errors
                    else NodeResult(name, one.result)
                    for name, one in outputs.items()
                ]
            )
        )
        return
    tables: dict[tuple[Column, ...], list[tuple[str, ResultTable]]] = {}
    for name, one in outputs.items():
        for result in one.results:
            if isinstance(result, ResultTable):
                tables.setdefault(result.columns, []).append((name, result))
    failed = dict(errors)
    for columns, found in tables.items():
        _print_table(out, columns, found, failed)
        failed = {}  # in the first table
    for name, one in outputs.items():
        for text in one.empty:
            one.say(text)
        for result in one.results:
            if isinstance(result, str) and result:
                out.text(*map(one.named, result.splitlines()))
        if name in failed:
            out.text(*one.named(f"error: {failed[name]}").split("\n"))


def _print_table(
    out: Output,
    columns: tuple[Column, ...],
    found: list[tuple[str, ResultTable]],
    errors: Mapping[str, SwarmError],
) -> None:
    for title in dict.fromkeys(table.title for _, table in found if table.title):
        out.text(title)
    rows = [(name, *row) for name, table in found for row in table.rows]
    if not errors:
        out.table([NODE, *columns], rows)
        return
    nothing: tuple[Cell, ...] = (None,) * len(columns)
    whole = [(*row, None) for row in rows]
    whole += [(name, *nothing, str(error)) for name, error in errors.items()]
    out.table([NODE, *columns, ERROR], whole)


def raise_errors(asked: int, errors: Mapping[str, SwarmError]) -> None:
    """Check that the command succeeded at all nodes.

    Raises: Partial when it failed at some; SwarmError when at all, of one kind if they agree.
    """
    if not errors:
        return
    text = f"{len(errors)} of {asked} nodes failed: {', '.join(errors)}"
    kinds = {type(error) for error in errors.values()}
    if len(errors) < asked:
        raise Partial(text)
    if len(kinds) == 1:
        # The exit code follows from the kind: scripts see the same one as after a command at one node.
        raise kinds.pop()(text)
    raise SwarmError(text)
