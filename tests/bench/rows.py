"""The form of a measured case: one row of the table of links (share/doc/links.md)."""

import json
from collections.abc import Iterable
from typing import NamedTuple


class Row(NamedTuple):
    """A case, what was measured, and its goal."""

    name: str
    figure: str
    goal: str
    is_met: bool


def print_rows(rows: Iterable[Row], *, as_json: bool) -> None:
    """Prints each row as soon as it is there: for people, or as a line of JSON."""
    for row in rows:
        if as_json:
            print(json.dumps(row._asdict(), ensure_ascii=False), flush=True)
        else:
            print(
                f"{row.name:<42}{row.figure}; goal {row.goal}{'' if row.is_met else '   MISSED'}", flush=True
            )
