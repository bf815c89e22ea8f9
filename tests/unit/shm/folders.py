"""Names of shared files that something else than a file occupies."""

import socket
from pathlib import Path


def folder(path: Path) -> None:
    path.mkdir()


def full_folder(path: Path) -> None:
    (path / "inner").mkdir(parents=True)


def link(path: Path) -> None:
    path.symlink_to("/etc/passwd")


def listener(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))
