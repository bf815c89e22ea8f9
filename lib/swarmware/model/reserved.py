"""Names and paths of a node's own daemons: no program of another user serves a path or bears a name of them.

Orders to a vehicle go to these paths. A member of the node's group may run programs on the node, and would
otherwise answer the orders of all users.
"""

from typing import Final

APPLICATIONS: Final = frozenset(
    {
        "broker",
        "control",
        "estimator",
        "files",
        "guard",
        "guidance",
        "hal",
        "health",
        "lidar",
        "logger",
        "mission",
        "navigator",
        "register",
        "sim",
        "timesync",
        "tree",
        "video",
    }
)
"""Names of the daemons. `tests/architecture` compares them with the installed ones."""
BRANCHES: Final = ("sys/", "cmd/")
"""Branches below which the daemons serve messages and requests. A test compares them with running daemons."""


def is_reserved_path(local: str) -> bool:
    """Whether only the user of the node may serve this local path."""
    return local.startswith(BRANCHES)
