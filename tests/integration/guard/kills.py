"""Kills daemons of a node together, or damages their shared files, repeatedly; measures the time until it is
whole.

`python -m tests.integration.guard.kills --count 200 --seed 7` prints the distribution; exit code 1 when a
trial took longer than the limit, or the node did not come back. The log of a slow trial is printed.
"""

import argparse
import asyncio
import fcntl
import os
import random
import signal
import sys
import tempfile
import time
import zlib
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from tests.patience import PATIENCE_S

from swarmware.errors import NoAnswer, NotFound, WireError
from swarmware.module.module import Module
from swarmware.service.fork_client import FOLDER, SOCKET
from swarmware.testing.process import Process, spawn
from swarmware.testing.tmpnode import make_node
from swarmware.transport.appfile.entry import AppEntry
from swarmware.transport.appfile.table import scan
from swarmware.transport.shm.ring import RingReader
from swarmware.types.health import GuardStatus
from swarmware.types.system import AppStatus

SERVICES: Final = (
    *("broker", "tree", "register", "timesync", "health", "guard", "mission", "logger"),
    *("hal", "sim", "control", "navigator"),
)
LIMIT_S: Final = 5.0
LOOK_S: Final = 0.01
BEAT_S: Final = 1.2
"""Every daemon checks all its shared files at least once in this time."""


class Harm(NamedTuple):
    """Description of a trial."""

    what: str
    killed: frozenset[int] = frozenset()
    """Processes that have to be replaced."""


Trial = Callable[[Path, random.Random], Harm]
"""Does its harm to the node of a root folder."""


def living(root: Path) -> dict[str, AppEntry]:
    """Daemons of the node by name."""
    return {entry.name: entry for entry in scan(root / "uav1/run") if entry.name in SERVICES}


def kill(root: Path, names: list[str]) -> Harm:
    """Sends SIGKILL to all of these processes at once."""
    entries = living(root)
    killed = frozenset(entries[name].pid for name in names)
    for pid in killed:
        os.kill(pid, signal.SIGKILL)
    return Harm("+".join(names), killed)


def one(root: Path, chance: random.Random) -> Harm:
    """Kills one random daemon."""
    return kill(root, [chance.choice(SERVICES)])


def guard_and_health(root: Path, chance: random.Random) -> Harm:
    """Kills guard and health, with or without a third daemon."""
    rest = [name for name in SERVICES if name not in {"guard", "health"}]
    return kill(root, ["guard", "health", *chance.sample(rest, chance.randrange(2))])


def some(root: Path, chance: random.Random) -> Harm:
    """Kills two or three random daemons."""
    return kill(root, chance.sample(SERVICES, chance.choice((2, 3))))


def guard_and_another(root: Path, chance: random.Random) -> Harm:
    """Kills the guard and one or two other daemons, except health."""
    rest = [name for name in SERVICES if name not in {"guard", "health"}]
    return kill(root, ["guard", *chance.sample(rest, chance.choice((1, 2)))])


def everybody(root: Path, chance: random.Random) -> Harm:
    """Kills all daemons at once."""
    return kill(root, chance.sample(SERVICES, len(SERVICES)))


def everybody_and_the_fork_server(root: Path, chance: random.Random) -> Harm:
    """Kills all daemons and the fork server, so that only the parent is left."""
    socket = str(root / "uav1/run" / FOLDER / SOCKET).encode()
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with suppress(OSError):  # it ended meanwhile, or is another user's
                words = (entry / "cmdline").read_bytes().split(b"\0")
                if b"forkserver" in words and socket in words:
                    os.kill(int(entry.name), signal.SIGKILL)
    harm = everybody(root, chance)
    return Harm(f"fork server+{harm.what}", harm.killed)


def _shared(root: Path, suffix: str, chance: random.Random) -> Path:
    return chance.choice(sorted((root / "uav1/shm").rglob(f"*{suffix}")))


def cut_ring(root: Path, chance: random.Random) -> Harm:
    """Every process that reads the file ends by SIGBUS."""
    path = _shared(root, ".ring", chance)
    os.truncate(path, chance.choice((0, 100, 4096)))
    return Harm(f"cut {path.name}")


def garble_ring(root: Path, chance: random.Random) -> Harm:
    """Random bytes for its header."""
    path = _shared(root, ".ring", chance)
    with path.open("r+b") as file:
        file.write(chance.randbytes(256))
    return Harm(f"garbled {path.name}")


def remove_ring(root: Path, chance: random.Random) -> Harm:
    """Under its living writer."""
    path = _shared(root, ".ring", chance)
    path.unlink()
    return Harm(f"removed {path.name}")


def harm_readers(root: Path, chance: random.Random) -> Harm:
    """Of all tables at once."""
    for path in (root / "uav1/shm").rglob("*.readers"):
        if path.is_dir():
            for name in path.iterdir():
                name.unlink()
        else:
            os.truncate(path, 0)
    return Harm("all tables of readers emptied")


def nested_application(root: Path, chance: random.Random) -> Harm:
    """A living application has a file that cannot be read, and two or three daemons are killed."""
    path = root / "uav1/run/apps/planner#1.toml"
    text = "config = " + "[" * 5000 + "]" * 5000 + "\n"
    path.write_text(f"{text}# crc32 {zlib.crc32(text.encode()):08x}\n", "utf-8")
    harm = some(root, chance)
    return Harm(f"{harm.what} beside an unreadable file", harm.killed)


TRIALS: Final[tuple[Trial, ...]] = (
    one,
    guard_and_health,
    guard_and_another,
    some,
    everybody,
    everybody_and_the_fork_server,
    cut_ring,
    garble_ring,
    remove_ring,
    harm_readers,
    nested_application,
)


def unreadable(root: Path) -> set[str]:
    """Rings that a new reader would refuse."""
    found = set()
    for path in (root / "uav1/shm").rglob("*.ring"):
        try:
            RingReader(path).close()
        except NotFound:
            continue  # it left this moment
        except WireError:
            found.add(path.name)
    return found


@asynccontextmanager
async def node(root: Path, processes: str = "per-daemon") -> AsyncIterator[tuple[Path, Process]]:
    """All daemons; the configuration folder of the node, and the parent of its processes."""
    services: dict[str, dict[str, int]] = {name: {} for name in SERVICES}
    # with one process for all it is the import of all daemons that takes the time
    config = make_node(root, services=services, processes=processes, fork_server=True)
    async with spawn(config, ready_s=PATIENCE_S) as parent:
        await whole(root, config, time.monotonic())
        with (root / "uav1/run/apps/planner#1.toml").open("w") as held:
            fcntl.flock(held, fcntl.LOCK_EX)  # an application that lives; what its file says comes later
            yield config, parent


async def whole(root: Path, config: Path, began_s: float, killed: frozenset[int] = frozenset()) -> float:
    """Seconds until every daemon lives, beats and is known by the guard to run, and every ring is readable.

    Raises: NoAnswer.
    """
    missing: set[str] = set()
    async with Module("probe", config_dir=config) as module:
        guard = module.reader("guard/status", GuardStatus)
        beats = {name: module.reader(f"app/{name}/status", AppStatus) for name in SERVICES}
        while time.monotonic() - began_s < PATIENCE_S:
            found = living(root)
            status = guard.value
            known = {one.name: one.pid for one in status.services if one.state == "running"} if status else {}
            known["guard"] = found["guard"].pid if "guard" in found else 0
            missing = {
                name
                for name in SERVICES
                if name not in found
                or found[name].pid in killed
                or known.get(name) != found[name].pid
                or (beat := beats[name].value) is None
                or (beat.pid, beat.state) != (found[name].pid, "running")
            }
            missing |= unreadable(root)
            if not missing:
                return time.monotonic() - began_s
            await asyncio.sleep(LOOK_S)
    raise NoAnswer(f"node: not whole after {PATIENCE_S} s: {missing}")


async def run(
    root: Path,
    trials: list[Trial],
    seed: int,
    say: Callable[[str], None],
    between: Callable[[], Awaitable[None]] | None = None,
) -> list[float]:
    """Runs each trial on the same node, with `between` before each; returns the durations in s."""
    chance = random.Random(seed)
    took: list[float] = []
    async with node(root) as (config, parent):
        for trial in trials:
            if between is not None:
                await between()
            said = len(parent.stderr())
            began_s = time.monotonic()
            harm = trial(root, chance)
            if not harm.killed:
                await asyncio.sleep(BEAT_S)  # a process that a damaged file kills dies when it reads the file
            took.append(await whole(root, config, began_s, harm.killed))
            say(f"{took[-1]:6.2f} s  {harm.what}")
            if took[-1] > LIMIT_S:
                say(parent.stderr()[said:])
    return took


def summary(took_s: list[float]) -> str:
    """Prints the distribution of the durations."""
    ordered = sorted(took_s)
    slow = sum(one_s > LIMIT_S for one_s in ordered)
    return (
        f"{len(ordered)} trials: p50 {ordered[len(ordered) // 2]:.2f} s, "
        f"p95 {ordered[int(len(ordered) * 0.95)]:.2f} s, max {ordered[-1]:.2f} s; {slow} over {LIMIT_S:g} s"
    )


def main() -> int:
    """The command line."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--count", type=int, default=100)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--only", choices=[trial.__name__ for trial in TRIALS])
    given = options.parse_args()
    kinds = [trial for trial in TRIALS if given.only in {None, trial.__name__}]
    trials = [kinds[number % len(kinds)] for number in range(given.count)]
    with tempfile.TemporaryDirectory(prefix="sw") as folder:
        took_s = asyncio.run(run(Path(folder), trials, given.seed, partial(print, flush=True)))
    by_kind: dict[str, list[float]] = {}
    for trial, one_s in zip(trials, took_s, strict=True):
        by_kind.setdefault(trial.__name__, []).append(one_s)
    for name, times_s in by_kind.items():
        print(f"{name:<30} {summary(times_s)}")
    print(f"{'all':<30} {summary(took_s)}")
    return 1 if max(took_s) > LIMIT_S else 0


if __name__ == "__main__":
    sys.exit(main())
