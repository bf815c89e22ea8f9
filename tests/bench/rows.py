"""The form of a measured case, and the guard of ratios against the load of the machine.

A row of the table of links (share/doc/links.md) is a `Row`. A ratio refers to a bare implementation that is
measured in the same run: `Bare` takes that figure three times at the start of the run and refuses each ratio
whose own bare figure is more than 20 % above the best of these, because other work was done beside it.
"""

import json
from collections.abc import Callable, Iterable
from typing import Final, NamedTuple, Self

REFUSED: Final = 3
"""Exit code of a benchmark of which a ratio was refused: its figures are partial."""
AT_START: Final = 3
ABOVE: Final = 1.2
"""Bare figure of a row, in multiples of the best one at the start, above which the row is refused."""


class Row(NamedTuple):
    """A case, its measurement, and its goal."""

    name: str
    figure: str
    goal: str
    is_met: bool
    refusal: str = ""
    """Why the row is refused, or "" if it was measured without other load."""

    @property
    def verdict(self) -> str:
        """Words for a row that is refused or missed its goal."""
        return f"REFUSED: {self.refusal}" if self.refusal else "" if self.is_met else "MISSED"


class Bare:
    """The figure of a bare implementation to which the ratios of a run refer."""

    def __init__(self, at_start: Iterable[float]) -> None:
        self.best = min(at_start)
        """The best figure of the start of the run; the smaller one is the better one."""
        self.refused = 0
        """Ratios that were refused."""

    @classmethod
    def measured(cls, measure: Callable[[], float]) -> Self:
        """Measures at the start of the run."""
        return cls(measure() for _ in range(AT_START))

    def refusal(self, figure: float) -> str:
        """Why a ratio to this bare figure is refused, or empty if it counts."""
        if figure <= ABOVE * self.best:
            return ""
        self.refused += 1
        return f"taken under load, bare {figure:.3g} where {self.best:.3g} was reached at the start"


def print_rows(rows: Iterable[Row], *, as_json: bool) -> None:
    """Prints each row as soon as it is measured, as text or as a line of JSON."""
    for row in rows:
        if as_json:
            print(json.dumps(row._asdict(), ensure_ascii=False), flush=True)
        else:
            print(f"{row.name:<42}{row.figure}; goal {row.goal}   {row.verdict}".rstrip(), flush=True)
