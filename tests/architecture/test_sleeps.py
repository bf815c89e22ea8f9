"""Every sleep is a pause that is meant: a process or test that waits for an event waits for that event."""

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


IN_TESTS: Final = {
    "the one place that looks again: what announces no change": {
        "tests/patience.py:until",
        "tests/patience.py:until_answer",
        "tests/boot/machine.py:Machine.__enter__",
        "tests/boot/test_operations.py:healed",
        "tests/boot/test_operations.py:test_a_whole_node_in_one_unit_is_back_when_all_its_processes_were_killed_at_once",
        "tests/boot/test_operations.py:test_the_guard_restarts_a_unit_through_systemd",
        "tests/boot/test_two_hosts.py:Swarm.until",
        "tests/integration/logger/events.py:fault",
        "tests/integration/node/test_names_from_outside.py:_commands",
    },
    "the interval over which is measured": {
        "tests/bench/channel_links.py:effect",
        "tests/bench/channel_links.py:plain",
        "tests/bench/hal_rates.py:bare",
        "tests/bench/hal_rates.py:loaded",
        "tests/bench/load16.py:measure",
        "tests/bench/load16.py:measure_all",
        "tests/bench/orders16.py:one",
        "tests/bench/radio_links.py:Bench.cuts",
        "tests/integration/broker/falling.py:measure",
        "tests/integration/broker/falling.py:watch_queue",
        "tests/integration/broker/onthewire.py:measure",
        "tests/integration/broker/overload.py:measure",
        "tests/integration/guard/kills.py:run",
        "tests/integration/guard/kills.py:whole",
        "tests/integration/register/test_two_platforms.py:"
        "test_a_partner_whose_applications_do_not_change_is_known_while_it_lives",
        "tests/integration/swarm/test_killed_daemons.py:kill_in_turn",
        "tests/integration/tree/adaptive_rate.py:measure",
        "tests/integration/tree/lossystream.py:measure",
        "tests/unit/mission/test_checking.py:measured.run.watch",
    },
    "the pace of a writer, a sender or an attacker": {
        "tests/bench/radio_links.py:Bench.messages",
        "tests/integration/broker/lossylink.py:send_all",
        "tests/integration/broker/overload.py:commands_ms",
        "tests/integration/broker/overload.py:offer",
        "tests/integration/broker/overload.py:write",
        "tests/integration/broker/test_false_beacons.py:Forger.forge",
        "tests/integration/broker/test_false_relays.py:"
        "test_where_every_beacon_is_signed_none_of_a_thousand_invented_values_is_taken_anywhere.drive",
        "tests/integration/broker/test_false_relays.py:"
        "test_where_the_origin_is_not_received_invented_values_end_soon_after_the_last_one.drive",
        "tests/integration/broker/test_hostile_frames.py:test_a_replayed_datagram_and_a_stranger_are_refused",
        "tests/integration/broker/test_large_values.py:"
        "test_a_value_of_64_mib_arrives_whole_and_one_byte_more_is_refused",
        "tests/integration/broker/test_live_roster.py:test_a_rotation_loses_no_message_and_no_beacon.write",
        "tests/integration/broker/test_sessions.py:"
        "test_a_record_of_a_dead_node_brings_neither_its_link_nor_its_values_back",
        "tests/integration/broker/test_sessions.py:write",
        "tests/integration/broker/test_strangers.py:test_a_flood_of_a_stranger_costs_no_link",
        "tests/integration/guard/steady_kills.py:run",
        "tests/integration/guard/test_priorities.py:"
        "test_a_heavy_process_yields_while_all_cores_are_in_use_and_the_next_guard_knows_it",
        "tests/integration/mission/swarm.py:FakeVehicle._navigate",
        "tests/integration/register/test_master.py:"
        "test_a_killed_master_is_replaced_and_gets_the_role_back_when_it_returns.keep_asking",
        "tests/integration/tree/lossystream.py:first_item",
        "tests/integration/tree/test_two_platforms.py:"
        "test_a_periodic_board_rides_in_the_beacon_and_is_mirrored",
        "tests/integration/tree/test_two_platforms.py:test_a_stream_arrives_whole_and_in_order_over_two_hops",
        "tests/integration/tree/test_two_platforms.py:"
        "test_after_a_gap_a_reader_two_hops_away_gets_the_state_and_goes_on_in_order",
        "tests/integration/tree/test_two_platforms.py:"
        "test_what_a_killed_platform_said_last_stays_readable_with_its_age",
        "tests/integration/tree/test_two_platforms.py:"
        "test_what_a_stream_loses_on_its_way_is_counted_at_its_reader_and_its_writer",
        "tests/unit/cli/test_tail.py:_log_late",
        "tests/unit/hal/test_end_writer.py:"
        "test_the_outputs_of_a_driver_that_hangs_take_their_safe_widths_until_it_is_back",
        "tests/unit/hal/test_serial.py:repeated",
        "tests/unit/hal/test_serial.py:"
        "test_a_vehicle_with_a_serial_chassis_is_armed_driven_and_killed_without_a_simulation",
        "tests/unit/mission/test_member_states.py:bells",
    },
    "the delay or outage itself is under test": {
        "tests/bench/channel_links.py:Lidar.outage",
        "tests/integration/files/lossyfile.py:measure",
        "tests/integration/guard/test_health.py:test_an_event_loop_that_stands_still_makes_its_checks_silent",
        "tests/integration/hal/test_starvation.py:Vehicle.pause",
        "tests/integration/hal/test_starvation.py:test_a_vehicle_whose_loop_was_away_lands_by_itself.fly",
        "tests/integration/node/actors.py:serve.slow",
        "tests/integration/node/services.py:Steady._block",
        "tests/integration/node/services.py:Steady.stop",
    },
    "nothing may happen meanwhile: the absence of an event has none": {
        "tests/integration/node/test_two_processes.py:"
        "test_a_receiver_restarted_within_the_time_gets_the_message.run",
        "tests/integration/node/test_two_processes.py:"
        "test_the_sender_is_told_when_the_receiver_is_killed_in_the_middle.run",
        "tests/unit/node/test_run_files.py:"
        "test_a_file_that_cannot_be_made_again_is_reported_once_and_tried_again",
        "tests/unit/service/test_guard_watchdog.py:"
        "test_a_guard_whose_file_another_process_locks_for_a_moment_is_started_again",
    },
    "virtual time": {
        "tests/unit/broker/test_unit_delay.py:test_frames_are_delivered_later_and_in_order.main",
        "tests/unit/broker/test_unit_delay.py:test_frames_that_are_held_back_at_the_end_are_dropped.main",
        "tests/unit/health/test_held_condition.py:test_a_condition_is_over_after_its_hold_time.main",
        "tests/unit/health/test_held_condition.py:test_a_condition_that_recurs_or_is_closed_does_not_end.main",
        "tests/unit/health/test_held_condition.py:"
        "test_damage_is_an_error_while_it_lasts_and_a_warning_after_it.main",
        "tests/unit/runtime/test_instant.py:"
        "test_tickers_of_different_periods_wake_the_process_only_at_multiples_of_them.main.tick",
        "tests/unit/service/test_beat.py:beats",
    },
}
"""Pauses of tests and benchmarks, by the reason that each is no wait for an event."""


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
    listed = MEANT.keys() | set[str]().union(*IN_TESTS.values())
    found = pausing("lib", "daemons", "cli", "tests")
    assert sorted(found - listed) == [], "wait for the event, or list the pause with its reason"
    assert sorted(listed - found) == [], "listed, and does not pause"
