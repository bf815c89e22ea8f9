"""Texts of errors: one line for foreseen errors, none for mistakes in the program."""

import errno

import pytest

from swarmware.errors import ConfigError, reason


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (ConfigError("x.toml: key a: unknown"), "x.toml: key a: unknown"),
        (
            OSError(errno.EROFS, "Read-only file system", "/var/lib/swarm"),
            "/var/lib/swarm: read-only file system; expected a file system that may be written",
        ),
        (
            OSError(errno.EMFILE, "Too many open files"),
            "too many open files; expected a higher limit of open files (ulimit -n, LimitNOFILE=)",
        ),
        (
            ExceptionGroup(
                "tasks",
                [ExceptionGroup("more", [OSError(errno.ENOSPC, "No space left on device", b"/dev/shm/x")])],
            ),
            "/dev/shm/x: no space left on device; expected room on its file system",
        ),
        (ExceptionGroup("tasks", [ConfigError("a"), ConfigError("a"), ConfigError("b")]), "a; b"),
        (ValueError("a mistake of ours"), None),
        (OSError(errno.EBADF, "Bad file descriptor"), None),
        (ExceptionGroup("tasks", [ConfigError("a"), KeyError("ours")]), None),
    ],
)
def test_external_cause_has_one_line_own_none(error: BaseException, line: str | None) -> None:
    assert reason(error) == line
