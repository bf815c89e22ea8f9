"""Confirmation before something irreversible; scripts give it as an option."""

import asyncio
import sys
from collections.abc import Iterable
from typing import Final

import click

from swarmctl.terminal.wrapping import fitted_text, terminal_width
from swarmware.model.visible import visible_lines

ANSWER: Final = 12
"""Columns for ` [y/N]: ` or `: `, and for the answer."""


def confirm(yes: bool, what: str) -> None:
    """Returns when the operator confirms, by option or at the prompt.

    Raises: UsageError without a terminal, Abort after a refusal.
    """
    if yes:
        return
    if not sys.stdin.isatty():
        raise click.UsageError(f"{what}: expected --yes, because stdin is not a terminal")
    click.confirm(_question(f"{what}. Continue?"), abort=True, err=True)


def confirm_by_name(name: str, given: str, what: str) -> None:
    """Returns when the name was typed a second time, in `--confirm` or at the prompt.

    Raises: UsageError when it differs, or without a terminal.
    """
    if not given:
        if not sys.stdin.isatty():
            raise click.UsageError(f"{what}: expected --confirm {name}, because stdin is not a terminal")
        given = click.prompt(_question(f"{what}. Type {name} to continue"), err=True)
    if given != name:
        raise click.UsageError(f"{what}: confirmed by {given!r}; expected the same name, {name!r}")


def _question(text: str) -> str:
    """A question with its answer on the same line, within the width of the terminal."""
    width = terminal_width(sys.stderr)
    return fitted_text(visible_lines(text), None if width is None else width - ANSWER)


class JointConfirmation:
    """One confirmation of a command at several nodes, asked when each node asks for it or has ended."""

    def __init__(self, nodes: Iterable[str]) -> None:
        self._running = set(nodes)
        self._effects: dict[str, str] = {}
        self._answered = asyncio.Event()
        self._last = asyncio.Event()
        self._refusal: BaseException | None = None

    async def confirm(self, yes: bool, node: str, what: str) -> None:
        """Returns when the operator confirms the effects at all nodes; `what` is "" if this node has none.

        Raises: as `confirm`.
        """
        if not yes:
            self._effects[node] = what
            self._ask()
            await self._answered.wait()
        if self._refusal is not None:
            raise self._refusal

    async def others_ended(self) -> None:
        """Returns when the command has ended at all other nodes."""
        if len(self._running) > 1:
            await self._last.wait()

    def finish(self, node: str) -> None:
        """The command has ended at a node."""
        self._running.discard(node)
        self._effects.pop(node, None)
        if len(self._running) <= 1:
            self._last.set()
        # The other nodes may all have asked already, and wait only for this one.
        self._ask()

    def fail(self, error: BaseException) -> None:
        """The command has an error that ends it at all nodes."""
        self._refusal = error
        self._answered.set()
        self._last.set()

    def _ask(self) -> None:
        # One question names the effects at all nodes, so it waits for the last node that may still ask.
        if self._answered.is_set() or not self._effects or self._running - self._effects.keys():
            return
        nodes: dict[str, list[str]] = {}
        for node, what in self._effects.items():
            if what:
                nodes.setdefault(what, []).append(node)
        try:
            confirm(not nodes, "; ".join(f"{', '.join(names)}: {what}" for what, names in nodes.items()))
        except (click.UsageError, click.Abort) as refusal:
            self._refusal = refusal
        self._answered.set()
