"""Size of the terminal, without `shutil`, which imports the modules of all archives."""

import os
import sys
from typing import Final

_WITHOUT: Final = os.terminal_size((80, 24))
"""Size where stdout is not a terminal."""


def terminal_columns() -> int:
    """Columns of the terminal, or of the variable COLUMNS."""
    return _given("COLUMNS") or _size().columns or _WITHOUT.columns


def terminal_lines() -> int:
    """Lines of the terminal, or of the variable LINES."""
    return _given("LINES") or _size().lines or _WITHOUT.lines


def _given(variable: str) -> int:
    text = os.environ.get(variable, "")
    return int(text) if text.isdecimal() else 0


def _size() -> os.terminal_size:
    try:
        # `sys.__stdout__`: a test or a pager may have replaced `sys.stdout`
        return os.get_terminal_size(sys.__stdout__.fileno() if sys.__stdout__ else 1)
    except (OSError, ValueError):
        return _WITHOUT
