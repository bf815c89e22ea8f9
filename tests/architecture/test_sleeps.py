"""Every sleep is a pause that is meant: a process or test that waits for an event waits for that event."""

import ast
from typing import Final

from tests.architecture.sources import ROOT, parsed

MEANT: Final = {
    "cli/swarmctl/commands/app/stopping.py:_until": "the stopped tree or register would carry the event",
    "cli/swarmctl/commands/fleet/agent.py:HostAgent._start": "another process started it: no notification",
    "cli/swarmctl/commands/fleet/synchronisation.py:Synchronisation.until": "an equal digest has no event",
    "cli/swarmctl/membership/activation.py:_reached": "the restarted broker would carry the event",
    "cli/swarmctl/resources/restart.py:restart_one": "the restarted broker or tree would carry the event",
    "cli/swarmlab/run/capacity.py:Capacity._sample": "the interval over which load is measured",
    "daemons/swarmd/broker/exchange/beacon_transport.py:BeaconTransport.look_up_seeds": "period of look-ups",
    "daemons/swarmd/broker/records/membership.py:Membership._forget": "another service has no event here",
    "daemons/swarmd/hal/buses/write_at_end.py:is_ours": "files of the kernel have no event",
    "daemons/swarmd/hal/buses/write_at_end.py:main": "heartbeats are taken together",
    "daemons/swarmd/logger/service.py:Logger._open_recorder": "back-off: a disk has no event",
    "daemons/swarmd/logger/upload.py:Upload.run": "back-off: a server that is away has no event",
    "daemons/swarmd/main.py:main": "limits the rate of restarts by systemd",
    "daemons/swarmd/mission/blocks/motions.py:HoldBlock.run": "the time in the mission",
    "daemons/swarmd/mission/blocks/motions.py:WaypointsBlock.run": "the time in the mission",
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


TESTS: Final = ("tests/unit", "tests/simulation", "tests/integration", "tests/boot")
IN_TESTS: Final = {
    "the one place that looks again: what announces no change": {
        "tests/boot/machine.py",
        "tests/boot/test_operations.py",
        "tests/boot/test_two_hosts.py",
        "tests/integration/logger/events.py",
        "tests/integration/node/test_names_from_outside.py",
    },
    "the interval over which is measured": {
        "tests/integration/broker/falling.py",
        "tests/integration/broker/onthewire.py",
        "tests/integration/broker/overload.py",
        "tests/integration/guard/kills.py",
        "tests/integration/register/test_two_platforms.py",
        "tests/integration/swarm/test_killed_daemons.py",
        "tests/integration/tree/adaptive_rate.py",
        "tests/integration/tree/lossystream.py",
        "tests/unit/mission/test_checking.py",
    },
    "the pace of a writer, a sender or an attacker": {
        "tests/integration/broker/lossylink.py",
        "tests/integration/broker/overload.py",
        "tests/integration/broker/test_false_beacons.py",
        "tests/integration/broker/test_false_relays.py",
        "tests/integration/broker/test_hostile_frames.py",
        "tests/integration/broker/test_large_values.py",
        "tests/integration/broker/test_live_roster.py",
        "tests/integration/broker/test_sessions.py",
        "tests/integration/broker/test_strangers.py",
        "tests/integration/guard/steady_kills.py",
        "tests/integration/guard/test_priorities.py",
        "tests/integration/mission/swarm.py",
        "tests/integration/register/test_master.py",
        "tests/integration/tree/lossystream.py",
        "tests/integration/tree/test_two_platforms.py",
        "tests/unit/cli/test_tail.py",
        "tests/unit/hal/test_end_writer.py",
        "tests/unit/hal/test_serial.py",
        "tests/unit/mission/test_member_states.py",
    },
    "the delay or outage itself is under test": {
        "tests/integration/files/lossyfile.py",
        "tests/integration/guard/test_health.py",
        "tests/integration/hal/test_starvation.py",
        "tests/integration/node/actors.py",
        "tests/integration/node/services.py",
    },
    "nothing may happen meanwhile: the absence of an event has none": {
        "tests/integration/node/test_two_processes.py",
        "tests/unit/node/test_run_files.py",
        "tests/unit/service/test_guard_watchdog.py",
    },
    "virtual time": {
        "tests/unit/broker/test_unit_delay.py",
        "tests/unit/health/test_held_condition.py",
        "tests/unit/runtime/test_instant.py",
        "tests/unit/service/test_beat.py",
    },
}
"""Files of tests that pause, by the reason that a pause there is not a wait for an event; benchmarks measure
over intervals."""


def is_sleep(call: ast.Call) -> bool:
    return getattr(call.func, "attr", getattr(call.func, "id", "")) in {"sleep", "nanosleep"}


def is_yield(call: ast.Call) -> bool:
    """`sleep(0)` gives other tasks one turn and waits for nothing."""
    return bool(call.args) and ast.unparse(call.args[0]) == "0"


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


def pausing(*folders: str) -> set[str]:
    return {
        place
        for folder in folders
        for path in (ROOT / folder).rglob("*.py")
        for place in pauses(parsed(path), f"{path.relative_to(ROOT)}:")
    }


def test_every_pause_is_listed_with_its_reason() -> None:
    in_tests = {place.partition(":")[0] for place in pausing(*TESTS)}
    for found, listed in (
        (pausing("lib", "daemons", "cli"), MEANT.keys()),
        (in_tests, set[str]().union(*IN_TESTS.values())),
    ):
        assert sorted(found - listed) == [], "wait for the event, or list the pause with its reason"
        assert sorted(listed - found) == [], "listed, and does not pause"
