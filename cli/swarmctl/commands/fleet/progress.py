"""Progress of each host: a live table on a terminal, lines elsewhere, JSON Lines for programs."""

from collections.abc import Sequence
from types import TracebackType
from typing import Final, Self

from swarmctl.commands.fleet.plan import FleetStep, HostState
from swarmctl.terminal.output import Output
from swarmctl.terminal.table import Cell, Column, fitted_table, show

COLUMNS: Final = (Column("HOST"), Column("STATE"), Column("STEPS"), Column("SYNC"), Column("ERROR"))


class FleetProgress:
    """What each host is doing."""

    def __init__(self, out: Output, names: Sequence[str]) -> None:
        self._out = out
        self._states = {name: FleetStep(name, HostState.WAITING) for name in names}

    def __enter__(self) -> Self:
        return self

    def show(self, step: FleetStep) -> None:
        """Show a step that begins, or the outcome of a host."""
        self._states[step.host] = step
        if self._out.settings.structured:
            self._out.line(step)
        elif self._out.redraws:
            self._draw(last=False)
        else:
            self._out.say(f"{step.host}: {step.state}{f': {step.error}' if step.error else ''}")

    def _draw(self, *, last: bool) -> None:
        rows = [[show(cell) for cell in _row(one)] for one in self._states.values()]
        self._out.redraw(fitted_table(COLUMNS, rows, self._out.width).text, last=last)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # after an error the live table stays as it was, and programs have had each step
        if self._out.settings.structured or error is not None:
            return
        if self._out.redraws:
            self._draw(last=True)
        else:
            self._out.table(COLUMNS, [_row(one) for one in self._states.values()])


def _row(step: FleetStep) -> tuple[Cell, ...]:
    synchronised = None if step.synchronised is None else "yes" if step.synchronised else "no"
    return step.host, step.state, ", ".join(step.steps), synchronised, step.error
