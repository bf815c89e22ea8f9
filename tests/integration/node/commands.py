"""A vehicle of several members, and `swarmctl` as a process."""

import asyncio
import sys
from pathlib import Path

VEHICLE = (
    "broker",
    "tree",
    "register",
    "timesync",
    "health",
    "guard",
    "mission",
    "hal",
    "sim",
    "control",
    "navigator",
)


async def swarmctl(config: Path, *words: str, code: int | None = 0) -> str:
    """`swarmctl …` of root at this node, to its end; both of its outputs."""
    child = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "swarmctl",
        *words,
        "--config",
        str(config),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    output = (await child.communicate())[0].decode()
    assert code is None or child.returncode == code, f"{words}: {child.returncode}\n{output}"
    return output
