"""Every sleep in the product is a pause that is meant: whoever waits for an event waits for that event."""

import ast
from pathlib import Path
from typing import Final

from tests.architecture.sources import parsed

ROOT: Final = Path(__file__).parents[2]
MEANT: Final = {
    "cli/swarmctl/commands/app/stopping.py:_until": "the stopped tree or register would carry the event",
    "cli/swarmctl/commands/fleet/agent.py:HostAgent._start": "another process started it: no notification",
    "cli/swarmctl/commands/fleet/synchronisation.py:Synchronisation.until": "an equal digest has no event",
    "cli/swarmctl/membership/activation.py:_reached": "the restarted broker would carry the event",
    "cli/swarmctl/resources/restart.py:restart_one": "the restarted broker or tree would carry the event",
    "cli/swarmlab/run/capacity.py:Capacity._sample": "the interval over which load is measured",
    "daemons/swarmd/broker/beacon_transport.py:BeaconTransport.look_up_seeds": "period of name resolution",
    "daemons/swarmd/broker/membership.py:Membership._forget": "a route at another service has no event here",
    "daemons/swarmd/hal/buses/write_at_end.py:is_ours": "files of the kernel have no event",
    "daemons/swarmd/hal/buses/write_at_end.py:main": "heartbeats are taken together",
    "daemons/swarmd/logger/service.py:Logger._open_recorder": "back-off: a disk has no event",
    "daemons/swarmd/logger/upload.py:Upload.run": "back-off: a server that is away has no event",
    "daemons/swarmd/main.py:main": "limits the rate of restarts by systemd",
    "daemons/swarmd/mission/blocks/motions.py:HoldBlock.run": "the time in the mission",
    "daemons/swarmd/tree/exchange/placement.py:PlacementMeasurement._measure": "interval of the measurement",
    "lib/swarmware/health/monitor.py:HealthMonitor._keep_registered": "back-off: the monitor refused",
    "lib/swarmware/testing/firmware.py:ChassisFirmware._report_always": "the period of its reports",
    "lib/swarmware/module/snapshot_stream.py:SnapshotStream._resynchronise": "back-off: the owner is away",
    "lib/swarmware/node/incarnation.py:NodeIncarnation._join": "others make a removed file again: no event",
    "lib/swarmware/runtime/instant.py:until": "the one wait for an instant",
    "lib/swarmware/service/guard_watchdog.py:GuardWatchdog._keep": "no descriptor is free: no event either",
    "lib/swarmware/service/guard_watchdog.py:GuardWatchdog._pause": "back-off before a restart",
    "lib/swarmware/service/host.py:ServiceHost._keep": "back-off before a restart",
    "lib/swarmware/transport/appfile/file.py:_touch_anothers": "a tick of the kernel's coarse clock",
    "lib/swarmware/transport/shm/lock.py:lock_within": "`flock` has no time-out; holders are short",
}
"""Pauses, by file and function, and why each is no wait for an event."""


def is_sleep(call: ast.Call) -> bool:
    return "sleep" in getattr(call.func, "attr", getattr(call.func, "id", ""))


def is_yield(call: ast.Call) -> bool:
    """`sleep(0)` gives other tasks one turn and waits for nothing."""
    return is_sleep(call) and ast.unparse(call) == "asyncio.sleep(0)"


def pauses(node: ast.AST, place: str) -> set[str]:
    """Functions below a node that sleep."""
    found: set[str] = set()
    for child in ast.iter_child_nodes(node):
        inner = place
        if isinstance(child, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            inner = f"{place}{'' if place.endswith(':') else '.'}{child.name}"
        elif isinstance(child, ast.Call) and is_sleep(child) and not is_yield(child):
            found.add(place)
        found |= pauses(child, inner)
    return found


def test_every_pause_is_listed_with_its_reason() -> None:
    found = {
        place
        for folder in ("lib", "daemons", "cli")
        for path in (ROOT / folder).rglob("*.py")
        for place in pauses(parsed(path), f"{path.relative_to(ROOT)}:")
    }
    assert sorted(found - MEANT.keys()) == [], "wait for the event, or list the pause with its reason"
    assert sorted(MEANT.keys() - found) == [], "listed, and does not pause"
