"""How a node and a lab end: by SIGTERM, by the operator's terminal, by an operator without patience."""

import asyncio
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.integration.swarm.starts import Starts
from tests.integration.swarm.swarm import remains_of_node, swarm, until_trees_agree
from tests.patience import PATIENCE_S

from swarmctl.session import labs
from swarmctl.session.labs import LabState

Gone = Callable[[LabState], None]

END_S = 5.0
"""What units of systemd and the contract of a node give it; on a busy machine, as long as starts take."""


@pytest.mark.slow
def test_node_ends_by_sigterm_and_removes_its_files(
    labs_folder: Path, tmp_path: Path, nothing_remains: Gone
) -> None:
    starts = Starts(tmp_path)

    async def run() -> LabState:
        async with swarm("k2end", per_daemon="uav1") as made:
            await made.start("gcs", "uav1", "ugv1")
            async with made.at("gcs") as ground, made.at("uav1") as vehicle:
                await until_trees_agree(ground, vehicle)  # all are busy with each other
            await starts.measure()
            for platform in ("uav1", "gcs", "ugv1"):
                code, took_s = await made.terminate(platform)
                how = made.record.node(platform).processes
                print(f"{platform} ({how}): {took_s:.2f} s")
                said = made.record.node(platform).log_file.read_text()
                assert code == 0, said
                assert took_s < max(END_S, starts.limit_s), said
                assert "Traceback" not in said
                assert remains_of_node(made.record, platform) == []
            return made.record

    nothing_remains(asyncio.run(run()))


class Terminal:
    """`swarmctl lab up` on a terminal of its own, as an operator has it before him."""

    def __init__(self, labs_folder: Path, *words: str) -> None:
        self._master, slave = os.openpty()
        self.process = subprocess.Popen(
            # its own session, of which the terminal is the controlling one: Ctrl-C and hang-up work
            ["setsid", "--ctty", sys.executable, "-m", "swarmctl", "lab", "up", "formation", *words],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            env={**os.environ, "SWARMCTL_LABS": str(labs_folder), "NO_COLOR": "1", "TERM": "dumb"},
        )
        os.close(slave)
        self.said = ""

    def read_to(self, words: str) -> None:
        """Reads what it says up to these words."""
        while words not in self.said:
            self.said += self._read()

    def read_on(self) -> None:
        """Reads until it has ended: a full terminal would hold it up."""
        try:
            while True:
                self.said += self._read()
        except OSError:  # EIO: nobody has the other end open any more
            return

    def _read(self) -> str:
        return os.read(self._master, 4096).decode(errors="replace")

    def key(self, key: bytes) -> None:
        os.write(self._master, key)

    def close(self) -> None:
        """The window is closed, or the connection lost."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1


@contextmanager
def terminal(labs_folder: Path, *words: str) -> Iterator[Terminal]:
    found = Terminal(labs_folder, *words)
    try:
        yield found
    finally:
        found.close()
        try:
            found.process.wait(PATIENCE_S)
        finally:
            found.process.kill()
            found.process.wait()


CTRL_C = b"\x03"


@pytest.mark.slow
@pytest.mark.parametrize("how", ["once", "without patience", "closed"])
def test_lab_on_terminal_ends_as_whole_with_it(labs_folder: Path, nothing_remains: Gone, how: str) -> None:
    with terminal(labs_folder, "--nodes", "3", "--per-daemon", "uav1", "--name", "k2tty") as window:
        window.read_to("Ctrl-C ends it")
        lab = labs.find("k2tty")
        assert lab.running
        if how == "closed":
            window.close()
        else:
            window.key(CTRL_C)
            window.read_to("ending lab")
            if how == "without patience":
                window.key(CTRL_C)
            window.read_on()
        code = window.process.wait(PATIENCE_S)
        assert how == "closed" or code == 130, window.said  # nobody is there to be told
        assert "Traceback" not in window.said, window.said
    nothing_remains(lab)
    assert not any(labs_folder.iterdir())
