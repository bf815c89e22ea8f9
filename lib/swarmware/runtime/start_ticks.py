"""Start time of a process, which distinguishes it from a later one with the same pid."""

_STATE, _START = 0, 19
"""Positions of state (field 3) and starttime (field 22) behind the command name. Source: proc_pid_stat(5)."""

_DEAD_STATES = frozenset("ZXx")
"""States of a process that executes no code any more, such as a zombie."""


def start_ticks(pid: int) -> int:
    """When the process started, in clock ticks since boot; 0 when it does not run.

    The command name may hold blanks and parentheses: fields count from the last ')'.
    Source: proc_pid_stat(5).
    """
    if not 0 < pid <= 0x7FFF_FFFF:
        return 0
    try:
        with open(f"/proc/{pid}/stat", "rb") as file:
            fields = file.read().rpartition(b")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return 0
    if len(fields) <= _START or fields[_STATE].decode("ascii", "replace") in _DEAD_STATES:
        return 0
    return int(fields[_START])


def lives(pid: int, started: int) -> bool:
    """Whether the process with this pid that started at this instant still executes code.

    Units: `started` in clock ticks since boot, as of `start_ticks`.
    """
    return start_ticks(pid) == started != 0
