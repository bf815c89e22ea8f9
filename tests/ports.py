"""Ports of the tests: no two tests that run at the same time get the same one."""

import fcntl
import os
import socket
import tempfile
from pathlib import Path
from typing import Final

PORTS: Final = range(10_000, 20_000, 2)
"""Ports below the range of labs and below the ephemeral range of the kernel, so that no other process takes
a port before the test listens there."""
LAST: Final = Path(tempfile.gettempdir()) / f"swarmware-tests-port-{os.getuid()}"
"""Contains the port that was given last, to whichever process."""


def free_port() -> int:
    """A free even port of UDP and TCP; the next odd port belongs to the caller as well."""
    with LAST.open("a+") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        last = int(file.read() or PORTS.start)
        for step in range(1, len(PORTS)):
            port = PORTS[(PORTS.index(last) + step) % len(PORTS)]
            if _is_free(port) and _is_free(port + 1):
                file.truncate(0)
                file.write(str(port))
                return port
    raise OSError(f"ports {PORTS.start}..{PORTS.stop}: none free")


def _is_free(port: int) -> bool:
    for kind in (socket.SOCK_DGRAM, socket.SOCK_STREAM):
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind(("", port))
            except OSError:
                return False
    return True
