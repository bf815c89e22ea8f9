"""The last writes of a driver whose process was killed: a process of its own makes them."""

import logging
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from swarmd.hal.buses import write_at_end
from swarmd.hal.driver import DeviceError

CLOSE_S: Final = 1.0
"""Time that the process has to write, after which it is killed."""
_PROGRAM: Final = str(Path(write_at_end.__file__))

log = logging.getLogger("swarm.hal")


class EndWriter:
    """Writes texts to files when this process ends, however it ends: a kernel keeps its outputs as they are.

    Raises: DeviceError when the process does not start.
    """

    def __init__(self, texts: Sequence[tuple[str, str]]) -> None:
        self._texts = [part for pair in texts for part in pair]
        self._process = self._started()
        ready = self._process.stdout
        assert ready is not None
        if not ready.read(1):
            self.close()
            raise DeviceError(f"{_PROGRAM}: ended at its start; expected a process that waits")

    def _started(self) -> subprocess.Popen[bytes]:
        try:
            return subprocess.Popen(
                [sys.executable, "-I", "-S", _PROGRAM, *self._texts],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,
            )
        except OSError as error:
            raise DeviceError(f"{_PROGRAM}: cannot be started: {error}") from error

    @property
    def pid(self) -> int:
        """Process id of the waiting process."""
        return self._process.pid

    def keep(self) -> None:
        """Starts the process again if something has ended it. Raises: DeviceError."""
        if self._process.poll() is not None:
            log.warning("the process that stops the outputs after a kill has ended: it is started again")
            self._close_pipes()
            self._process = self._started()

    def close(self) -> None:
        """Ends the process, which writes the texts now."""
        self._close_pipes()
        try:
            self._process.wait(CLOSE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _close_pipes(self) -> None:
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
