"""The program: entry point of the installed `swarmctl` and of `python -m swarmctl`."""

import gc
import sys
from typing import Final, NoReturn

YOUNG_LIMIT: Final = 100_000
"""New objects before a collection: a short command makes fewer, and a collection among its imports finds
nothing. With the default of 700 they took a tenth of the time of a command."""


def program() -> NoReturn:
    """Runs the command of the command line and ends the process."""
    gc.set_threshold(YOUNG_LIMIT)
    from swarmctl.main import main  # after the limit is set

    code = main()
    gc.freeze()  # else the interpreter searches all modules for cycles at its end
    sys.exit(code)


if __name__ == "__main__":
    program()
