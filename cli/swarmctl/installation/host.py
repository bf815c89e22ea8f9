"""The host as it is, and the steps that change it."""

import fnmatch
import os
import pwd
import shutil
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final

from swarmctl.installation.step import HostStep, StepAction
from swarmware.errors import Denied, NotFound, SwarmError
from swarmware.runtime.filewriter import replace_file

SERVICE_USER: Final = "swarm"
"""User and group of the daemons under systemd."""
SYSTEMD: Final = Path("/run/systemd/system")
"""Exists while systemd runs."""


class Host:
    """Files, users and units of a computer; `root`: where its paths begin."""

    def __init__(self, root: Path = Path("/")) -> None:
        self._root = root

    def place(self, path: str) -> Path:
        """A path of the host."""
        return self._root / path.lstrip("/")

    def check_ready(self, what: str) -> None:
        """Check that this process may change the host, and that systemd runs.

        Raises: Denied, NotFound.
        """
        if os.geteuid() != 0:
            raise Denied(
                f"{what}: needs root; expected `sudo swarmctl {what} …`, or --dry-run to see its steps"
            )
        if not self.place(str(SYSTEMD)).is_dir():
            raise NotFound(
                f"{what}: systemd does not run here ({SYSTEMD} is missing); expected a host that it booted."
                " Elsewhere write node.toml and start `swarmd node`"
            )

    # -- present state

    def content(self, path: str) -> bytes | None:
        """Content of a file, or None if it does not exist. Raises: Denied when this user may not read it."""
        try:
            return self.place(path).read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None
        except PermissionError as error:
            raise Denied(f"{path}: not readable by this user; expected root") from error

    def link(self, path: str) -> str | None:
        """Target of a symbolic link, or None for any other path."""
        found = self.place(path)
        return str(found.readlink()) if found.is_symlink() else None

    def exists(self, path: str) -> bool:
        """Whether there is a file, folder or link."""
        return os.path.lexists(self.place(path))

    def matches(self, folder: str, pattern: str) -> list[str]:
        """Paths in a folder that match, in their order; also links to what is missing."""
        place = self.place(folder)
        found = sorted(one.name for one in place.iterdir()) if place.is_dir() else []
        return [f"{folder}/{name}" for name in fnmatch.filter(found, pattern)]

    def user(self, name: str) -> tuple[int, int] | None:
        """User id and group id, or None for an unknown user."""
        try:
            found = pwd.getpwnam(name)
        except KeyError:
            return None
        return found.pw_uid, found.pw_gid

    def is_member(self, user: str, group: str) -> bool:
        """Whether a user is in a group. Raises: NotFound for an unknown user."""
        ids, of_group = self.user(user), self.user(group)
        if ids is None:
            raise NotFound(f"user {user!r}: not known on this computer; expected a login")
        return of_group is not None and of_group[1] in os.getgrouplist(user, ids[1])

    def not_owned(self, folder: str, user: tuple[int, int]) -> bool:
        """Whether something in a folder does not belong to a user."""
        return any(found.lstat().st_uid != user[0] for found in self._below(folder))

    def closed_to(self, folder: str, group: int) -> list[str]:
        """Files directly in a folder that are for a group, but not for this one and not for all."""
        found = [one for one in self._below(folder) if one.is_file() and not one.is_symlink()]
        return [
            f"/{one.relative_to(self._root)}"
            for one in found
            if one.stat().st_mode & 0o044 == 0o040 and one.stat().st_gid != group
        ]

    def states(self, units: Sequence[str]) -> dict[str, str]:
        """State of each unit: active, inactive, failed, activating …; none where systemd does not run."""
        if not units or not self.place(str(SYSTEMD)).is_dir():
            return {}
        done = subprocess.run(["systemctl", "is-active", *units], capture_output=True, text=True, check=False)
        # not strict, as systemctl prints fewer lines when it cannot reach systemd
        return dict(zip(units, done.stdout.split(), strict=False))

    def _below(self, folder: str) -> Iterator[Path]:
        try:
            place = self.place(folder)
            if place.is_dir():
                yield place
                for directory, folders, files in os.walk(place):
                    yield from (Path(directory) / name for name in (*folders, *files))
        except PermissionError as error:
            raise Denied(f"{folder}: not readable by this user; expected root") from error

    # -- changes

    def carry_out(self, steps: Iterable[HostStep]) -> Iterator[HostStep]:
        """Carry out steps in their order, and yield each that is done.

        Raises: SwarmError with the message of a program that failed, OSError; earlier steps stay done.
        """
        for step in steps:
            self._one(step)
            yield step

    def _one(self, step: HostStep) -> None:
        path = self.place(step.target)
        match step.action:
            case StepAction.WRITE:
                path.parent.mkdir(parents=True, exist_ok=True)
                replace_file(path, step.content, mode=step.mode)
            case StepAction.LINK:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.unlink(missing_ok=True)
                path.symlink_to(step.content.decode())
            case StepAction.REMOVE:
                # a link to a folder is removed, never the content of its target
                if path.is_dir() and not path.is_symlink():
                    shutil.rmtree(path)
                else:
                    path.unlink(missing_ok=True)
            case StepAction.RUN:
                self.run(step.words)

    def run(self, words: Sequence[str]) -> str:
        """Run a program; returns its output.

        Raises: SwarmError with its message, NotFound when it is not installed.
        """
        try:
            done = subprocess.run(
                words, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL
            )
        except FileNotFoundError as error:
            raise NotFound(f"{words[0]}: not installed; expected a host with systemd") from error
        if done.returncode:
            text = (done.stderr or done.stdout).strip()
            raise SwarmError(f"{' '.join(words)}: {text or f'exit code {done.returncode}'}")
        return done.stdout
