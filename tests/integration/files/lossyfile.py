"""Two nodes over a loopback that drops packets; prints how a file is sent and fetched, and cut in the middle.

Run by test_files.py as `unshare --net python lossyfile.py LOSS_PERCENT CUT_S`.
"""

import asyncio
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

import uvloop
from tests.integration.tree.pair import Platform, platforms
from tests.patience import until

FILE_BYTES: Final = 1_000_000
SERVICES: Final = (("broker", "tree", "files"),)
CUT_AT: Final = 0.3
"""Share of the blocks after which the link is cut."""


def drop(percent: int) -> None:
    """Drops this ratio of all arriving packets, in both directions."""
    what = "drop" if percent >= 100 else f"numgen random mod 100 < {percent} drop"
    rules = f"""
        table inet radio {{
            chain input {{
                type filter hook input priority 0;
                {what}
            }}
        }}
    """
    subprocess.run(["nft", "delete", "table", "inet", "radio"], check=False, capture_output=True)
    subprocess.run(["nft", "-f", "-"], input=rules, text=True, check=True)


async def swarmctl(node: Platform, *words: str) -> dict[str, object]:
    """Runs a command, and parses its JSON output."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "swarmctl", "--config", str(node.config_dir), *words, "--json",
        stdout=asyncio.subprocess.PIPE,
    )  # fmt: skip
    out, _ = await process.communicate()
    assert process.returncode == 0, (words, process.returncode)
    found: dict[str, object] = json.loads(out)
    return found


def held_share(folder: Path) -> float:
    """Share of the blocks that have arrived; the marks are a file."""
    shares = [held.count(1) / len(held) for marks in folder.glob(".*.have") if (held := marks.read_bytes())]
    return max(shares, default=0.0)


async def until_held(folder: Path, share: float) -> None:
    """Returns when this share of the blocks has arrived."""
    await until(lambda: held_share(folder) >= share)


async def measure(root: Path, percent: int, cut_s: float) -> dict[str, object]:
    async with platforms(root, "gcs", "uav1", services=SERVICES) as (gcs, uav1):
        await gcs.until_listed("/uav1/sys/files/offer", lambda entry: entry is not None)
        source = root / "map.bin"
        source.write_bytes(random.Random(1).randbytes(FILE_BYTES))
        folder = uav1.probe.node.config.data_path / "files"
        drop(percent)
        began_s = time.monotonic()
        async with asyncio.TaskGroup() as group:
            sending = group.create_task(swarmctl(gcs, "file", "send", str(source), "--node", "uav1"))
            if cut_s:
                await until_held(folder, CUT_AT)
                drop(100)
                await asyncio.sleep(cut_s)
                drop(percent)
        sent_s = time.monotonic() - began_s
        began_s = time.monotonic()
        fetched = await swarmctl(
            gcs, "file", "get", "map.bin", "--node", "uav1", "--to", str(root / "back.bin")
        )
        got_s = time.monotonic() - began_s
        stored, back = (folder / "map.bin").read_bytes(), (root / "back.bin").read_bytes()
        return {
            "sent": stored == source.read_bytes(),
            "fetched": back == source.read_bytes(),
            "digests": len({sending.result()["digest"], fetched["digest"]}),
            "sent_s": sent_s,
            "got_s": got_s,
            "left": len(list(folder.glob(".*"))),
        }


if __name__ == "__main__":
    subprocess.run(["ip", "link", "set", "lo", "mtu", "1500", "up"], check=True)
    os.environ.pop("SWARM_CONFIG", None)
    with (
        tempfile.TemporaryDirectory(prefix="sw") as place,
        asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner,
    ):
        print(json.dumps(runner.run(measure(Path(place), int(sys.argv[1]), float(sys.argv[2])))))
