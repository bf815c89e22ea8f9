"""The example in C, written from the protocol page: it joins a node, reads another one's pose, answers."""

import asyncio
import contextlib
import fcntl
import json
import shutil
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.integration.tree.pair import Platform, on_uvloop, platforms
from tests.patience import PATIENCE_S

from swarmware.errors import WireError
from swarmware.types.scalar import Text
from swarmware.types.vehicle import Pose

SOURCE = Path(__file__).parents[3] / "share" / "swarm" / "examples" / "c" / "listener.c"
CC = shutil.which("cc")
ECHO = "cmd/echo"

pytestmark = pytest.mark.skipif(CC is None, reason="no C compiler (cc) on this machine")


@pytest.fixture(scope="module")
def listener(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program, built as its first lines say."""
    program = tmp_path_factory.mktemp("c") / "listener"
    words = [str(CC), "-std=c11", "-O2", "-Wall", "-Wextra", "-o", str(program), str(SOURCE), "-lm"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return program


@asynccontextmanager
async def started(*words: str | Path) -> AsyncIterator[asyncio.subprocess.Process]:
    """The program, which leaves in good order when it gets SIGTERM."""
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(*map(str, words), stdout=pipe, stderr=pipe)
    try:
        yield process
    finally:
        if process.returncode is None:
            process.terminate()
        _, said = await process.communicate()
        assert process.returncode == 0, said


async def applications(platform: Platform) -> set[str]:
    """What `swarmctl app ls` lists."""
    words = ("-m", "swarmctl", "--json", "--config", str(platform.config_dir), "app", "ls")
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(sys.executable, *words, stdout=pipe)
    out, _ = await process.communicate()
    found: dict[str, Any] = json.loads(out)
    return {f"{app['name']}#{app['instance']}" for app in found["units"][0]["table"]["applications"]}


def opened_by(process: asyncio.subprocess.Process) -> set[Path]:
    """Files that the process has open, as far as they can still be seen."""
    found = set()
    for fd in Path(f"/proc/{process.pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            found.add(fd.readlink())
    return found


@on_uvloop
async def test_c_program_waiting_for_removed_lock_keeps_instance(listener: Path, tmp_path: Path) -> None:
    async with platforms(tmp_path, "gcs", tree={"keep": []}) as (gcs,), asyncio.timeout(PATIENCE_S):
        path = gcs.probe.node.run_dir / "apps" / "listener#1.toml"
        with path.open("w") as held:
            # as a process does that mistakes it for the file of a dead application
            fcntl.flock(held, fcntl.LOCK_EX)
            async with started(listener, gcs.config_dir, "/gcs/nav/pose") as process:
                async for _ in gcs.probe.every(0.002):
                    if path in opened_by(process):
                        break
                path.unlink()
                held.close()
                await gcs.until_listed("/gcs/cmd/echo", lambda entry: entry is not None)
                assert f"pid = {process.pid}\n" in path.read_text()


@on_uvloop
async def test_c_program_reads_pose_and_answers_requests(listener: Path, tmp_path: Path) -> None:
    async with (
        platforms(tmp_path, "uav1", "gcs", tree={"keep": []}) as (uav, gcs),
        started(listener, gcs.config_dir, "/uav1/nav/pose") as process,
        asyncio.timeout(PATIENCE_S),
    ):
        pose = uav.probe.writer("nav/pose", Pose, rate_hz=10.0)

        async def fly() -> None:
            async for _ in uav.probe.every(0.05):
                pose.write(Pose(pose.sequence + 0.25, -2.0, 3.5))

        flight = uav.probe.start(fly(), "flight")
        assert process.stdout is not None
        lines = [(await process.stdout.readline()).decode().split() for _ in range(5)]
        flight.cancel()
        assert [(y, z) for _, y, z, *_ in lines] == [("-2.000", "3.500")] * 5
        xs = [float(x) for x, *_ in lines]
        assert xs == sorted(set(xs))
        assert all(x % 1 == 0.25 for x in xs)

        assert "listener#1" in await applications(gcs)
        await gcs.until_listed("/gcs/cmd/echo", lambda entry: entry is not None and entry.owner == "listener")
        assert (await gcs.set(ECHO, "through the tree")).data == b"\x91\xb0through the tree"
        asked = [
            gcs.probe.request(ECHO, Text(f"{n}" * 40 * n), Text, timeout_s=PATIENCE_S) for n in range(10)
        ]
        assert [answer.value for answer in await asyncio.gather(*asked)] == [
            f"{n}" * 40 * n for n in range(10)
        ]
        with pytest.raises(WireError, match="cmd/echo: no Text"):
            await gcs.probe.request(ECHO, Text("x" * 8000), Text, timeout_s=PATIENCE_S)

        process.terminate()
        assert await process.wait() == 0
        assert "listener#1" not in await applications(gcs)
        assert list(gcs.probe.node.run_dir.rglob(f"*{process.pid}*")) == []
