"""The program: entry point of the installed `swarmctl` and of `python -m swarmctl`."""

import atexit
import gc
import os
import sys
import threading
from typing import Final, NoReturn

from swarmctl.commandline.late_modules import late_modules

YOUNG_LIMIT: Final = 100_000
"""New objects before a collection: a short command makes fewer, and a collection among its imports finds
nothing. With the default of 700 they took a tenth of the time of a command."""


def program() -> NoReturn:
    """Runs the command of the command line and ends the process."""
    gc.set_threshold(YOUNG_LIMIT)
    with late_modules():
        from swarmctl.main import main  # after the limit is set

    _end(main())


def _end(code: int) -> NoReturn:
    """Ends the process without taking its modules apart, which took a twentieth of the time of a command."""
    if threading.active_count() > 1:
        sys.exit(code)  # it waits for the other threads
    atexit._run_exitfuncs()
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError):
        sys.exit(code)
    os._exit(code)


if __name__ == "__main__":
    program()
