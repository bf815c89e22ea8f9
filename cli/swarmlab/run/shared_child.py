"""A process that the nodes of a lab share, as a child of the process that starts the lab."""

import asyncio
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Final

from swarmctl.session.labs import LabState
from swarmlab.run.child import child_environment, exit_description, tail
from swarmlab.run.notify import NotifySocket
from swarmware.errors import Denied, NoAnswer, SwarmError
from swarmware.runtime.processes import WatchedProcess


class SharedChild:
    """Starts the process and watches it."""

    def __init__(
        self,
        lab: LabState,
        name: str,
        command: list[str],
        on_change: Callable[[], None],
        variables: dict[str, str] | None = None,
    ) -> None:
        """`name`: for files and messages, such as `radio`; `on_change`: called when the process has ended."""
        self._lab = lab
        self._name: Final = name
        self._command = command
        self._variables = variables or {}
        self._folder = Path(lab.folder)
        self._on_change = on_change
        self._child: subprocess.Popen[bytes] | None = None
        self._process: WatchedProcess | None = None
        self._code: int | None = None

    @property
    def log(self) -> Path:
        """File in the lab's folder with the output of the process."""
        return self._folder / f"{self._name.replace(' ', '-')}.txt"

    async def start(self, timeout_s: float) -> None:
        """Starts the process; returns when it is ready.

        Raises: Denied without the rights, SwarmError when it ends, NoAnswer when it is not ready in time.
        """
        loop, changed = asyncio.get_running_loop(), asyncio.Event()
        notify = NotifySocket(self.log.with_name(f"{self.log.stem}-notify"))

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
                    # the process may have ended before it was ready, and would never become so
                    self.check()
                    await changed.wait()
        except TimeoutError:
            raise NoAnswer(
                f"lab {self._lab.name}: its {self._name} is not ready; expected within {timeout_s:g} s"
            ) from None
        finally:
            loop.remove_reader(notify.fileno())
            notify.close()

    def _launch(self, notify_path: Path) -> int:
        """Starts the process; returns its pid."""
        with self.log.open("ab") as log:
            self._child = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,  # its end shows the process that the lab's starter has ended
                stdout=log,
                stderr=subprocess.STDOUT,
                env=child_environment(self._lab, notify_path) | self._variables,
                start_new_session=True,
            )
        return self._child.pid

    def check(self) -> None:
        """Raises: SwarmError with the end of its log when it has ended, Denied for lack of rights."""
        if self._code is None:
            return
        # the child reports lack of rights by its exit code, which the command passes on
        error = Denied if self._code == Denied.exit_code else SwarmError
        raise error(
            f"{self._name} of lab {self._lab.name}: ended with {exit_description(self._code)} ({self.log});"
            f" expected to run\n{tail(self.log)}"
        )

    def _on_end(self) -> None:
        assert self._child is not None
        self.stop_watching()
        self._code = self._child.wait()
        self._on_change()

    def stop_watching(self) -> None:
        """Stops watching; the process continues."""
        if self._process is not None:
            self._process.close()
            self._process = None

    def detach(self) -> None:
        """Lets this process end before the child."""
        if self._child is not None and self._child.returncode is None:
            self._child.returncode = 0  # without this the interpreter warns that it still runs

    def wait(self) -> None:
        """Waits for the exit code of the ended process."""
        if self._child is not None:
            # its end asks the process to end, too: without that the wait could last for ever
            self._close_input()
            self._child.wait()

    def _close_input(self) -> None:
        assert self._child is not None
        if self._child.stdin is not None:
            self._child.stdin.close()
