"""Real-time scheduling of declared services: given to a process of its own, or a reason why not."""

import errno
import os
import subprocess
import sys
from pathlib import Path
from unittest.mock import patch

import pytest

from swarmware.errors import ConfigError
from swarmware.model.config import NodeConfig, RealtimeConfig, parse
from swarmware.service.realtime import give_realtime

HAL = RealtimeConfig(services={"hal": 50, "control": 45})
PROGRAM = """
import os, sys, threading
from swarmware.model.config import RealtimeConfig
from swarmware.service.realtime import give_realtime
reason = give_realtime(RealtimeConfig(policy=sys.argv[1], services={"hal": 30, "control": 20}), ["hal"])
found = []
thread = threading.Thread(target=lambda: found.append(os.sched_getscheduler(0)))
thread.start()
thread.join()
refused = reason.replace(" ", "_") or "-"
print(os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, found[0], refused)
with open("/proc/self/status") as file:
    print(next(line for line in file if line.startswith("VmLck:")).split()[1])
"""


@pytest.mark.parametrize(("policy", "number"), [("fifo", os.SCHED_FIFO), ("rr", os.SCHED_RR)])
def test_own_process_and_threads_get_policy(policy: str, number: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, policy], capture_output=True, text=True, check=True, timeout=60
    )
    found, priority, of_thread, refused, locked_kib = done.stdout.split()
    if refused != "-":
        pytest.skip(f"this user may not: {refused}")
    assert (int(found), int(priority), int(of_thread)) == (number, 30, number)
    assert int(locked_kib) > 5_000, "the interpreter alone has more"


@pytest.mark.parametrize(("limit", "expected"), [(8 << 20, "at most 8192 KiB are permitted"), (-1, "EPERM")])
def test_unlockable_memory_is_reported_and_scheduling_stays(limit: int, expected: str) -> None:
    with (
        patch("swarmware.service.realtime._privileged", return_value=False),
        patch("resource.getrlimit", return_value=(limit, limit)),
        patch("ctypes.CDLL") as library,
        patch("ctypes.get_errno", return_value=errno.EPERM),
        patch("os.sched_setscheduler") as call,
    ):
        library.return_value.mlockall.return_value = -1
        reason = give_realtime(HAL, ["hal"])
        call.assert_called_once()
    assert reason.startswith("memory is not locked: ")
    assert expected in reason
    assert reason.endswith("expected LimitMEMLOCK=infinity (realtime.conf), or CAP_IPC_LOCK")


def test_nothing_is_changed_where_nothing_is_declared() -> None:
    with patch("os.sched_setscheduler") as call:
        assert give_realtime(RealtimeConfig(), ["hal"]) == ""
        assert give_realtime(HAL, ["logger", "tree"]) == ""
        call.assert_not_called()


def test_service_sharing_process_gets_no_policy() -> None:
    with patch("os.sched_setscheduler") as call:
        reason = give_realtime(HAL, ["hal", "logger"])
        call.assert_not_called()
    assert reason.startswith("hal shares its process with logger; expected a process of its own")
    with (
        patch("os.sched_setscheduler") as call,
        patch("swarmware.service.realtime.lock_memory", return_value=""),
    ):
        assert give_realtime(HAL, ["hal", "control"]) == ""
        (_, _, param), _ = call.call_args
        assert param.sched_priority == 50


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (PermissionError(1, "Operation not permitted"), "fifo 50 is not permitted; expected LimitRTPRIO=50"),
        (OSError(22, "Invalid argument"), "fifo 50: Invalid argument; expected a kernel"),
    ],
)
def test_system_refusal_is_reported_with_expectation(error: OSError, expected: str) -> None:
    with patch("os.sched_setscheduler", side_effect=error):
        assert give_realtime(HAL, ["hal"]).startswith(expected)


def test_only_known_services_and_priorities_are_accepted() -> None:
    good = 'services = ["hal"]\n[realtime]\nservices = { hal = 99 }\n'
    assert parse(good, NodeConfig, "node.toml").realtime.services == {"hal": 99}
    with pytest.raises(ConfigError, match=r"realtime\.services: 'hall' is not one of the services"):
        parse(good.replace("{ hal", "{ hall"), NodeConfig, "node.toml")
    with pytest.raises(ConfigError, match=r"realtime\.services"):
        parse(good.replace("99", "100"), NodeConfig, "node.toml")


def test_unit_of_systemd_permits_it_with_limit() -> None:
    text = (Path(__file__).parents[3] / "share/swarm/systemd/realtime.conf").read_text()
    assert {"RestrictRealtime=no", "LimitRTPRIO=60", "LimitRTTIME=500ms", "LimitMEMLOCK=infinity"} <= set(
        text.splitlines()
    )
