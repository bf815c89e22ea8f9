"""`swarmctl fleet` against a real SSH server: three hosts on this machine, to running and back."""

import json
import signal
import subprocess
import time
from pathlib import Path
from typing import Any, Final

from tests.integration.fleet.conftest import NAMES, Fleet

SYNCHRONISED_S: Final = 20.0


def listed(fleet: Fleet) -> dict[str, dict[str, Any]]:
    done = fleet.ctl("ls", "-o", "json")
    assert done.returncode == 0, done.stderr
    return {one["host"]: one for one in json.loads(done.stdout)["hosts"]}


def test_hosts_are_pushed_started_listed_and_ended(fleet: Fleet) -> None:
    pushed = fleet.ctl("push")
    assert pushed.returncode == 0, pushed.stderr + pushed.stdout

    # the command is killed when the first node begins to start
    child = subprocess.Popen(
        fleet.words("up", "-o", "jsonl"), stdout=subprocess.PIPE, text=True, env=fleet.env
    )
    assert child.stdout is not None
    with child.stdout:
        while json.loads(child.stdout.readline())["state"] != "start":
            pass
        child.send_signal(signal.SIGKILL)
    child.wait()

    started = fleet.ctl("up", "-o", "jsonl")
    assert started.returncode == 0, started.stderr + started.stdout
    outcomes = [one for one in map(json.loads, started.stdout.splitlines()) if one["done"]]
    assert {one["host"] for one in outcomes} == set(NAMES)

    found = listed(fleet)
    assert {name: one["status"]["answers"] for name, one in found.items()} == dict.fromkeys(NAMES, True)
    assert {name: one["config"] for name, one in found.items()} == dict.fromkeys(NAMES, "current")
    until = time.monotonic() + SYNCHRONISED_S
    while not all(one["synchronised"] for one in found.values()) and time.monotonic() < until:
        found = listed(fleet)  # nodes that have just started are in the middle of it
    assert {name: one["synchronised"] for name, one in found.items()} == dict.fromkeys(NAMES, True)

    done = fleet.ctl("exec", "-H", "uav*", "--", "printf", "%s\n", "a 'b' $HOME; exit 9", "*")
    assert sorted(done.stdout.splitlines()) == sorted(
        f"{name}: {line}" for name in ("uav1", "uav2") for line in ("a 'b' $HOME; exit 9", "*")
    )
    assert fleet.ctl("exec", "--", "test", "-d", f"{fleet.folder}/uav1/etc").returncode == 0

    ended = fleet.ctl("down", "--yes")
    assert ended.returncode == 0, ended.stderr + ended.stdout
    assert fleet.processes() == []
    assert list(Path("/dev/shm").glob(f"{fleet.folder.name}-*/*")) == []
