"""Child processes of a lab: their environment, how they ended, and the end of their logs."""

import os
from pathlib import Path
from typing import Final

from swarmctl.session.labs import LabState
from swarmctl.session.processes import MARK
from swarmware.model.config import CONFIG_VARIABLE

TAIL_LINES: Final = 12
"""Lines of the log of an ended process in its error message."""

KEEP: Final = "SWARM_KEEP"
"""Variable with the folder that the parents of nodes keep from cleaners of temporary files."""
ENVIRONMENT: Final = {
    # thread pools of many processes would compete for the cores
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "PYTHONUNBUFFERED": "1",
}


def child_environment(lab: LabState, notify_path: Path) -> dict[str, str]:
    """Environment of a child: marked, with its own notification socket, without the operator's options."""
    kept = {
        key: value
        for key, value in os.environ.items()
        # options of the operator's command would apply to the nodes as well, and join them to another node
        if not key.startswith("SWARMCTL_") and key != CONFIG_VARIABLE
    }
    # a watchdog of this process's own service is not the children's to serve
    kept.pop("WATCHDOG_USEC", None)
    return kept | ENVIRONMENT | {MARK: lab.mark, KEEP: lab.folder, "NOTIFY_SOCKET": str(notify_path)}


def exit_description(code: int) -> str:
    """An exit code of `subprocess` as text."""
    return f"signal {-code}" if code < 0 else f"exit code {code}"


def tail(log_file: Path) -> str:
    """The last lines of a log, indented, or "" without a log."""
    try:
        lines = log_file.read_text("utf-8", "replace").splitlines()
    except OSError:  # no log was written: nothing to show
        return ""
    return "\n".join(f"  | {line}" for line in lines[-TAIL_LINES:])
