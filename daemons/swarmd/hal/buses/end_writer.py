"""End writer: a separate process writes the safe outputs when the driver's process hangs or is killed."""

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
"""Time for the process to write before it is killed."""
_PROGRAM: Final = str(Path(write_at_end.__file__))
_END: Final = b"e"
_MARGIN: Final = 0.5
"""Ratio of `held_s` above which a silence may already have triggered the process."""

log = logging.getLogger("swarm.hal")


class EndWriter:
    """Writes texts to files when this process hangs or ends, because the kernel would keep its outputs
    unchanged.

    `held_s`: time without a call of `keep` after which the texts are written. `dead_s`: time after the end of
    this process, unless another process has changed the files by then.
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
        # the first byte means that the process waits; without it a crash now would leave the outputs on
        if not ready.read(1):
            self.close()
            raise DeviceError(f"{_PROGRAM}: ended at its start; expected a running process")

    def _started(self) -> subprocess.Popen[bytes]:
        try:
            process = subprocess.Popen(
                # isolated and without `site`: starts fast, and does not depend on installed packages
                [sys.executable, "-I", "-S", _PROGRAM, str(self._held_s), str(self._dead_s), *self._texts],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                # a signal to the daemon's process group must not end the process that guards against it
                start_new_session=True,
            )
        except OSError as error:
            raise DeviceError(f"{_PROGRAM}: cannot be started: {error}") from error
        assert process.stdin is not None
        # a heartbeat must never block the control loop
        os.set_blocking(process.stdin.fileno(), False)
        return process

    @property
    def pid(self) -> int:
        """Process id of the end writer's process."""
        return self._process.pid

    def keep(self) -> bool:
        """Sends a heartbeat; returns True if the process may have written since the previous heartbeat.

        A process that has ended is started again. Raises: DeviceError.
        """
        now_s = time.monotonic()
        since_s, self._kept_s = now_s - self._kept_s, now_s
        if self._process.poll() is not None:
            log.warning(
                "the end writer, which makes the outputs safe if this driver hangs, has ended; started again"
            )
            self._close_pipes()
            self._process = self._started()
        self._send(b".")
        return since_s > _MARGIN * self._held_s

    def _send(self, word: bytes) -> None:
        stdin = self._process.stdin
        if stdin is not None and not stdin.closed:
            with suppress(BlockingIOError, BrokenPipeError):  # a full pipe has enough heartbeats
                os.write(stdin.fileno(), word)

    def leave(self) -> None:
        """Closes this side only; the process writes after `dead_s`, unless another driver changes the
        outputs."""
        self._close_pipes()
        threading.Thread(target=self._process.wait, name="hal-end", daemon=True).start()

    def close(self) -> None:
        """Ends the process, which writes the texts at once."""
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
