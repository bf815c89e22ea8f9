"""The last writes of a driver whose process hangs or was killed: a process of its own makes them."""

import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from swarmd.hal.buses import write_at_end
from swarmd.hal.driver import DeviceError

CLOSE_S: Final = 1.0
"""Time that the process has to write, after which it is killed."""
_PROGRAM: Final = str(Path(write_at_end.__file__))
_END: Final = b"e"
_MARGIN: Final = 0.5
"""Share of the time of silence from which the process may have written."""

log = logging.getLogger("swarm.hal")


class EndWriter:
    """Writes texts to files when this process hangs or ends: a kernel keeps its outputs as they are.

    `held_s`: time without a call of `keep` after which the texts are written; `dead_s`: the same where this
    process has ended, unless another one has changed the files by then.
    Raises: DeviceError when the process does not start.
    """

    def __init__(self, texts: Sequence[tuple[str, str]], held_s: float, dead_s: float = 0.0) -> None:
        self._texts = [part for pair in texts for part in pair]
        self._held_s = held_s
        self._dead_s = dead_s
        self._process = self._started()
        self._kept_s = time.monotonic()
        ready = self._process.stdout
        assert ready is not None
        if not ready.read(1):
            self.close()
            raise DeviceError(f"{_PROGRAM}: ended at its start; expected a process that waits")

    def _started(self) -> subprocess.Popen[bytes]:
        try:
            process = subprocess.Popen(
                [sys.executable, "-I", "-S", _PROGRAM, str(self._held_s), str(self._dead_s), *self._texts],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,
            )
        except OSError as error:
            raise DeviceError(f"{_PROGRAM}: cannot be started: {error}") from error
        assert process.stdin is not None
        os.set_blocking(process.stdin.fileno(), False)
        return process

    @property
    def pid(self) -> int:
        """Process id of the waiting process."""
        return self._process.pid

    def keep(self) -> bool:
        """A heartbeat of the driver; True if the process may have written since the last one.

        Starts the process again if something has ended it. Raises: DeviceError.
        """
        now_s = time.monotonic()
        since_s, self._kept_s = now_s - self._kept_s, now_s
        if self._process.poll() is not None:
            log.warning(
                "the process that stops the outputs of a driver that hangs has ended: it is started again"
            )
            self._close_pipes()
            self._process = self._started()
        self._send(b".")
        return since_s > _MARGIN * self._held_s

    def _send(self, word: bytes) -> None:
        stdin = self._process.stdin
        if stdin is not None and not stdin.closed:
            with suppress(BlockingIOError, BrokenPipeError):  # a full pipe has heartbeats enough
                os.write(stdin.fileno(), word)

    def leave(self) -> None:
        """Ends this side only: the process writes after its time, unless another driver changes the
        outputs."""
        self._close_pipes()
        threading.Thread(target=self._process.wait, name="hal-end", daemon=True).start()

    def close(self) -> None:
        """Ends the process, which writes the texts now."""
        self._send(_END)
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
