"""A terminal of a reader: the blocks of a page run in one shell, one after the other."""

import os
import selectors
import signal
import subprocess
import time
from contextlib import suppress
from itertools import count
from pathlib import Path

import psutil

BLOCK_S = 180.0
END_S = 60.0
POLL_S = 0.2
"""For the end of a shell whose output is still open in a process that it left."""


class Terminal:
    """A bash in a session of its own: variables, the current folder and jobs last from block to block."""

    def __init__(self, home: Path, blocks: Path, env: dict[str, str]) -> None:
        self._blocks = blocks
        self._numbers = count()
        self._shell = subprocess.Popen(
            ["bash"],
            cwd=home,
            env=env,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    @property
    def folder(self) -> Path:
        """The current folder."""
        return Path(f"/proc/{self._shell.pid}/cwd").readlink()

    def run(self, text: str, *, strict: bool = True) -> tuple[int, str]:
        """Exit code and output of a block; `strict`: the first command that fails ends it, and the shell."""
        assert self._shell.stdin is not None
        block = self._blocks / f"block-{next(self._numbers)}"
        block.write_text(text)
        options = "set -eo pipefail" if strict else "set +eo pipefail"
        mark = f"end-of-{block}"
        self._shell.stdin.write(f"{options}; . {block} </dev/null; printf '\\n%s %s\\n' {mark} $?\n".encode())
        self._shell.stdin.flush()
        return self._until(mark, text)

    def _until(self, mark: str, text: str) -> tuple[int, str]:
        assert self._shell.stdout is not None
        seen = b""
        end_s = time.monotonic() + BLOCK_S
        with selectors.DefaultSelector() as selector:
            selector.register(self._shell.stdout, selectors.EVENT_READ)
            while time.monotonic() < end_s:
                if selector.select(POLL_S):
                    data = os.read(self._shell.stdout.fileno(), 65536)
                    seen += data
                    output, found, code = seen.decode(errors="replace").partition(f"\n{mark} ")
                    if found and code.endswith("\n"):
                        return int(code.split()[0]), output
                    if not data:
                        break
                elif self._shell.poll() is not None:
                    break
            else:
                raise AssertionError(f"no end after {BLOCK_S} s\n{text}\n{seen.decode(errors='replace')}")
        return self._shell.wait(END_S), seen.decode(errors="replace")

    def close(self) -> None:
        """End the shell and every process that a page left in it."""
        assert self._shell.stdin is not None and self._shell.stdout is not None
        jobs = [job for job in psutil.process_iter() if _session_of(job) == self._shell.pid]
        with suppress(BrokenPipeError):  # the shell has ended
            self._shell.stdin.close()
        for job in jobs:
            with suppress(psutil.NoSuchProcess):
                job.send_signal(signal.SIGTERM if job.pid != self._shell.pid else signal.SIGHUP)
        for job in psutil.wait_procs(jobs, END_S)[1]:
            job.kill()
        self._shell.stdout.close()
        self._shell.wait(END_S)


def _session_of(process: psutil.Process) -> int:
    """Session of a process, or 0 if the process has ended."""
    try:
        return os.getsid(process.pid)
    except ProcessLookupError:
        return 0
