"""The radio of a lab as a child of the process that starts the lab."""

import asyncio
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

from swarmctl.session.labs import LabState
from swarmlab.run.child import child_environment, exit_description, tail
from swarmlab.run.notify import NotifySocket
from swarmware.errors import Denied, NoAnswer, SwarmError
from swarmware.runtime.processes import WatchedProcess

LOG: Final = "radio.txt"
"""File in the lab's folder with the output of the radio."""
SOCKET: Final = "radio-notify"


class RadioChild:
    """Starts the radio and watches it: without it no node reaches another one."""

    def __init__(self, lab: LabState, on_change: Callable[[], None]) -> None:
        """`on_change`: called when the radio has ended."""
        self._lab = lab
        self._folder = Path(lab.folder)
        self._on_change = on_change
        self._child: subprocess.Popen[bytes] | None = None
        self._process: WatchedProcess | None = None
        self._code: int | None = None

    async def start(self, timeout_s: float) -> None:
        """Starts the radio; returns when it forwards frames.

        Raises: Denied without the rights, SwarmError when it ends, NoAnswer when it is not ready in time.
        """
        loop, changed = asyncio.get_running_loop(), asyncio.Event()
        notify = NotifySocket(self._folder / SOCKET)

        def on_notify() -> None:
            notify.drain()
            changed.set()

        def on_end() -> None:
            self._on_end()
            changed.set()

        loop.add_reader(notify.fileno(), on_notify)
        try:
            self._process = WatchedProcess(self._launch(notify.path), on_end)
            async with asyncio.timeout(timeout_s):
                while not notify.ready:
                    changed.clear()
                    self.check()
                    await changed.wait()
        except TimeoutError:
            raise NoAnswer(
                f"lab {self._lab.name}: its radio is not ready; expected within {timeout_s:g} s"
            ) from None
        finally:
            loop.remove_reader(notify.fileno())
            notify.close()

    def _launch(self, notify_path: Path) -> int:
        """Starts the process; returns its pid."""
        with (self._folder / LOG).open("ab") as log:
            self._child = subprocess.Popen(
                [sys.executable, "-m", "swarmlab.radio", self._lab.folder],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=child_environment(self._lab, notify_path),
                start_new_session=True,
            )
        return self._child.pid

    def check(self) -> None:
        """Raises: SwarmError with the end of its log when the radio has ended, Denied for lack of rights."""
        if self._code is None:
            return
        log = self._folder / LOG
        error = Denied if self._code == Denied.exit_code else SwarmError
        raise error(
            f"radio of lab {self._lab.name}: ended with {exit_description(self._code)} ({log});"
            f" expected to run\n{tail(log)}"
        )

    def _on_end(self) -> None:
        assert self._child is not None
        self.stop_watching()
        self._code = self._child.wait()
        self._on_change()

    def stop_watching(self) -> None:
        """Stops watching; the radio continues."""
        if self._process is not None:
            self._process.close()
            self._process = None

    def detach(self) -> None:
        """Lets this process end before the radio."""
        if self._child is not None and self._child.returncode is None:
            self._child.returncode = 0  # without this the interpreter warns that it still runs

    def wait(self) -> None:
        """Waits for the exit code of the ended radio."""
        if self._child is not None:
            self._child.wait()
