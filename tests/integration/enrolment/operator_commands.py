"""An operator whose commands run as processes, with a configuration folder of its own."""

import asyncio
import os
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from tests.patience import PATIENCE_S


class Operator:
    """Types `swarmctl keys …` on the computer of a node."""

    def __init__(self, root: Path) -> None:
        self._env = {**os.environ, "SWARMCTL_ROOT": str(root), "NO_COLOR": "1"}

    async def start(self, config_dir: Path, *words: str, group: str = "keys") -> asyncio.subprocess.Process:
        env = {**self._env, "SWARM_CONFIG": str(config_dir)}
        pipe = asyncio.subprocess.PIPE
        return await asyncio.create_subprocess_exec(
            sys.executable, "-m", "swarmctl", group, *words, env=env, stdin=pipe, stdout=pipe, stderr=pipe
        )

    async def keys(self, config_dir: Path, *words: str) -> str:
        """The output of a command that succeeds."""
        return await ended(await self.start(config_dir, *words))

    async def run(self, config_dir: Path, group: str, *words: str) -> str:
        """The output of a command of another group that succeeds."""
        return await ended(await self.start(config_dir, *words, group=group))

    @asynccontextmanager
    async def inviting(self, config_dir: Path, *platforms: str) -> AsyncIterator[list[str]]:
        """The words of each `keys join`; at the end all have joined."""
        command = ("invite", *platforms, "--address", "127.0.0.1", "--valid", "60s")
        process = await self.start(config_dir, *command)
        assert process.stdout is not None
        try:
            async with asyncio.timeout(PATIENCE_S):
                lines = [(await process.stdout.readline()).decode().split() for _ in platforms]
            yield [line[3] for line in lines]
            await ended(process)
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()


async def ended(process: asyncio.subprocess.Process) -> str:
    async with asyncio.timeout(PATIENCE_S):
        out, err = await process.communicate()
    assert process.returncode == 0, err.decode() + out.decode()
    return out.decode()
