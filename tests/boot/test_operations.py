"""share/doc/operations.md and the systemd part of a tutorial, letter by letter on a booted real systemd."""

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests.boot.machine import ROOT, CannotBoot, Machine, wheels, why_not
from tests.boot.page import PAGE, section

from swarmware.model.config import NodeConfig

SERVICE = ROOT / "share/doc/tutorials/service.md"
HOWTO = ROOT / "share/doc/howto"
USER = "olivia"
HEAL_S = 20.0

pytestmark = [
    pytest.mark.root,
    pytest.mark.slow,
    pytest.mark.timeout(600),
    pytest.mark.skipif(bool(why_not()), reason=why_not() or "it may"),
]


@pytest.fixture(scope="module")
def node(wheel: Path) -> Iterator[Machine]:
    """A machine on which the page was followed up to its operators."""
    try:
        machine = Machine(dist=wheel, wheels=wheels())
    except CannotBoot as error:
        pytest.skip(f"no container with systemd here: {error}")
    try:
        with machine:
            machine.prepare()
            for block in section(PAGE, "Install", "uav1"):
                machine.must(block)
            machine.must(f"useradd --create-home --shell /bin/bash {USER}")
            machine.must(section(PAGE, "Operators")[0].replace("NAME", USER))
            yield machine
    except CannotBoot as error:
        pytest.skip(f"no container with systemd here: {error}")


def states(machine: Machine) -> dict[str, str]:
    """Unit → its state."""
    listed = machine.must("systemctl list-units --all --plain --no-legend --no-pager 'swarm*'")
    return {words[0]: words[2] for words in map(str.split, listed.splitlines())}


def pid(machine: Machine, service: str) -> int:
    return int(machine.must(f"systemctl show --property=MainPID --value swarmd@{service}"))


def left(machine: Machine) -> str:
    """What of the node is in memory: shared memory, application files, sockets, doorbells, processes."""
    files = "ls -d /dev/shm/swarm-* /run/swarm/*/* 2>/dev/null || true"
    processes = "grep -l 'bin.[s]warmd' /proc/[0-9]*/cmdline 2>/dev/null || true"
    return machine.must(f"{files}; {processes}")


def healed(machine: Machine, also: Callable[[], bool] = lambda: True) -> None:
    """Every unit is active, and stays so while the node answers."""
    deadline_s = time.monotonic() + HEAL_S
    while not also() or set(states(machine).values()) != {"active"}:
        assert time.monotonic() < deadline_s, machine.must("journalctl --no-pager -u 'swarm*' -n 60")
        time.sleep(0.2)
    assert "uav1" in machine.must("swarmctl node ls")


def test_every_service_of_node_toml_is_active(node: Machine) -> None:
    expected = {f"swarmd@{name}.service" for name in NodeConfig().services} | {"swarm.target"}
    assert states(node) == dict.fromkeys(expected, "active")


def test_a_member_of_the_group_operates_the_node(node: Machine) -> None:
    for command in section(PAGE, "Operators")[1].splitlines():
        assert "uav1" in node.must(command, USER) or "x_m" in node.must(command, USER), command
    assert json.loads(node.must("swarmctl doctor --json", USER))["results"]
    assert "x_m" in node.must("timeout 20 swarmctl tree watch nav/pose --count 2", USER)
    node.must("swarmctl config set navigator/altitude_kp 1.5", USER)
    assert "pose" in node.must(
        "swarmctl log query nav/pose --limit 1 || swarmctl log query /uav1/nav/pose", USER
    )


def test_member_of_group_changes_no_file_of_daemons(node: Machine) -> None:
    writable = node.must("find /dev/shm/swarm-uav1 -name '*.ring' -writable -not -user $USER", USER)
    assert writable == ""
    for path in ("/run/swarm/apps/tree#1.toml", "/dev/shm/swarm-uav1/nav.pose.ring", "/run/swarm/boot"):
        assert node.run(f"rm -f '{path}'", USER).returncode != 0
        node.must(f"test -e '{path}'")
    assert node.run("ls /etc/swarm/keys", USER).returncode != 0


def test_member_module_is_read_by_daemons_and_root(node: Machine) -> None:
    script = (
        "import asyncio\nfrom swarmware import Module\nfrom swarmware.types.scalar import Float\n"
        "async def main():\n"
        "    async with Module('my-module') as m:\n"
        "        board = m.writer('mine/value', Float, rate_hz=10)\n"
        "        print('ready', flush=True)\n"
        "        async for _ in m.every(0.1):\n"
        "            board.write(Float(1.5))\n"
        "asyncio.run(main())\n"
    )
    node.must(f"cat > module.py <<'END'\n{script}END", USER)
    node.must("(/opt/swarm/bin/python module.py >module.log 2>&1 & echo $! >module.pid); sleep 0", USER)
    try:
        value = node.must(
            "i=0; until swarmctl --json tree get mine/value; do i=$((i+1)); test $i -lt 20; sleep 0.2; done"
        )
        assert json.loads(value[value.index("{") :])["value"] == 1.5
    finally:
        node.must("kill -9 $(cat module.pid)", USER)
    # the master, a daemon, tidies up after it
    there = "ls /run/swarm/apps/my-module*.toml 2>/dev/null"
    node.must(f"i=0; while {there}; do i=$((i+1)); test $i -lt 50; sleep 0.1; done")


def test_the_service_of_the_tutorial_runs_under_systemd(node: Machine) -> None:
    (block,) = section(SERVICE, "5. Run it under systemd", marked=True)
    node.must("swarmctl new service lookout")
    try:
        journal = node.must(block)
        assert "Started" in journal and "warning" not in journal.lower(), journal
        assert "lookout#1" in node.must("swarmctl app ls")
        get = "swarmctl --json tree get lookout/distance"
        assert "value" in node.must(f"i=0; until {get}; do i=$((i+1)); test $i -lt 20; sleep 0.2; done")
        # the page: the unit starts and stops with swarm.target, and comes back when its process ends
        before = node.must("systemctl show -p MainPID --value lookout").strip()
        node.must(f"kill -9 {before}")
        again = "systemctl is-active lookout && test $(systemctl show -p MainPID --value lookout) != "
        node.must(f"i=0; until {again} {before}; do i=$((i+1)); test $i -lt 100; sleep 0.2; done")
        node.must("systemctl stop swarm.target")
        assert node.run("systemctl is-active lookout").stdout.strip() == "inactive"
        node.must("systemctl start swarm.target")
        healed(node, lambda: node.run("systemctl is-active lookout").returncode == 0)
    finally:
        node.must("systemctl disable --now lookout; rm /etc/systemd/system/lookout.service")
        node.must("systemctl daemon-reload; rm -r lookout /etc/swarm/services/lookout.toml")
        node.must("/opt/swarm/bin/pip uninstall --quiet --yes lookout")


@pytest.mark.parametrize("service", ["tree", "guard", "broker"])
def test_a_killed_daemon_comes_back(node: Machine, service: str) -> None:
    before = pid(node, service)
    node.must(f"kill -9 {before}")
    healed(node, lambda: pid(node, service) not in {0, before})


def test_daemon_killed_often_is_still_restarted(node: Machine) -> None:
    kill = "p=$(systemctl show -p MainPID --value swarmd@timesync); test $p = 0 || kill -9 $p"
    node.must(f"i=0; while [ $i -lt 40 ]; do i=$((i+1)); {kill}; sleep 0.2; done")
    assert int(node.must("systemctl show -p NRestarts --value swarmd@timesync")) > 10
    healed(node)


def test_daemon_that_cannot_start_takes_no_core(node: Machine) -> None:
    file = "/etc/swarm/services/timesync.toml"
    node.must(f"cp {file} kept.toml; echo 'nonsense = 1' >> {file}")
    try:
        node.must(
            "systemctl --no-block restart swarmd@timesync; sleep 8"
        )  # a restart on request sets the count to 0
        assert 1 <= int(node.must("systemctl show -p NRestarts --value swarmd@timesync")) <= 5
        assert "nonsense" in node.must("journalctl --no-pager -u swarmd@timesync -n 20")
    finally:
        node.must(f"cp kept.toml {file}")
    healed(node)


def test_whole_node_in_one_unit_returns_after_kill(node: Machine) -> None:
    single, back = section(PAGE, "One unit for the whole node")
    node.must(single)
    for processes in ("one", "per-daemon"):
        node.must(f"sed -i 's/^processes = .*/processes = \"{processes}\"/' /etc/swarm/node.toml")
        node.must("systemctl restart swarm-node")
        for who in ("main", "all"):
            before = node.must("systemctl show -p MainPID --value swarm-node")
            node.must(f"systemctl kill --signal=KILL --kill-who={who} swarm-node")
            deadline_s = time.monotonic() + HEAL_S
            while (
                node.must("systemctl show -p MainPID --value swarm-node") in {"0\n", before}
                or node.run("systemctl is-active swarm-node").returncode
            ):
                assert time.monotonic() < deadline_s, node.must("journalctl --no-pager -u swarm-node -n 30")
                time.sleep(0.2)
            assert "uav1" in node.must("swarmctl node ls")
    node.must("systemctl stop swarm-node")
    assert left(node) == ""
    node.must(back)
    healed(node)


def test_the_guard_restarts_a_unit_through_systemd(node: Machine) -> None:
    before = pid(node, "timesync")
    node.must("""swarmctl tree set /uav1/sys/guard/restart '{"service":"timesync"}' --yes""")
    deadline_s = time.monotonic() + HEAL_S
    while pid(node, "timesync") in {0, before}:
        assert time.monotonic() < deadline_s, node.must("journalctl --no-pager -u swarmd@guard -n 20")
        time.sleep(0.2)


def test_everyday_commands_work_and_stop_leaves_nothing(node: Machine) -> None:
    day, devices, _realtime = section(PAGE, "Daily operation")
    lines = day.splitlines()
    stop = next(number for number, line in enumerate(lines) if line.startswith("systemctl stop"))
    node.must("\n".join(lines[: stop + 1]))
    assert set(states(node).values()) <= {"inactive"}
    assert left(node) == ""
    node.must("\n".join(lines[stop + 1 :]))
    node.must(devices)
    assert set(states(node).values()) == {"active"}


def test_services_get_documented_scheduling_or_report_why_not(node: Machine) -> None:
    realtime = section(PAGE, "Daily operation")[2]
    config, units = "/etc/swarm/node.toml", "/etc/systemd/system/swarmd@{hal,control}.service.d/realtime.conf"
    node.must(f"cp --preserve=all {config} kept.toml")
    try:
        scheduled = node.must(realtime)
        healed(node)
        if "SCHED_FIFO" in scheduled:
            assert "priority: 50" in scheduled
        else:  # a container may be denied it by the kernel of this machine
            healed(node, lambda: "hal/realtime" in node.run("swarmctl health faults").stdout)
    finally:
        node.must(f"bash -c 'rm -f {units}'; mv kept.toml {config}; systemctl daemon-reload")
        node.must("systemctl restart swarmd@hal swarmd@control")
    healed(node)


def followed(machine: Machine, block: str) -> None:
    """Runs each line of a block, and ends a command that follows a log after three seconds."""
    for line in block.splitlines():
        machine.must(f"timeout 3 {line} || test $? = 124" if "--follow" in line else line)


def test_services_restart_and_logs_read_as_documented(node: Machine) -> None:
    restart, logs = HOWTO / "restart.md", HOWTO / "process-logs.md"
    followed(node, section(restart, "A service, from any node")[0])
    (block,) = section(restart, "A service or a node under systemd", marked=True)
    followed(node, "\n".join(line for line in block.splitlines() if "swarm-node" not in line))
    healed(node)
    followed(node, section(logs, "Under systemd", marked=True)[0])
    refused = node.run("swarmctl app stop logger --node uav1 --yes")
    assert refused.returncode == 5 and "systemctl" in refused.stderr


def test_upgrade_and_uninstallation_pages_work_on_node(node: Machine) -> None:
    upgrade, heading = HOWTO / "upgrade.md", "A node under systemd"
    removal, purge = section(HOWTO / "uninstall.md", heading, marked=True)
    node.must("swarmctl config set navigator/altitude_kp 1.7")
    for part in ("Before", heading, "After"):
        for block in section(upgrade, part, marked=True):
            node.must(block)
    assert "1.7" in node.must("swarmctl config get navigator/altitude_kp")
    healed(node)
    node.must("cp -a /opt/swarm /mnt/swarm")
    again = "test -d /opt/swarm || cp -a /mnt/swarm /opt/"
    try:
        node.must(removal)
        assert left(node) == ""
        assert states(node) == {}
        node.must("test -f /etc/swarm/node.toml && test -d /var/lib/swarm")
        node.must(f"{again}; /opt/swarm/bin/swarmctl host install")
        healed(node)
        node.must(purge)
        found = node.must(
            "find / -xdev -path /mnt -prune -o -path /root -prune -o -path /proc -prune -o"
            " -name '*swarm*' -print"
        )
        assert found.replace("\n", " ").strip() in {"", "/home"}, found
        assert node.run("getent passwd swarm").returncode == 2
        assert node.run("getent group swarm").returncode == 2
    finally:
        node.must(f"{again}; rm -r /mnt/swarm")
        node.must(section(PAGE, "Install", "uav1")[0])
        node.must(section(PAGE, "Operators")[0].replace("NAME", USER))


def test_upgrade_keeps_settings_and_removal_leaves_configuration(node: Machine) -> None:
    (upgrade,), (removal,) = section(PAGE, "Upgrade"), section(PAGE, "Removal")
    node.must("swarmctl config set navigator/altitude_kp 1.7")
    node.must(upgrade)
    assert "1.7" in node.must("swarmctl config get navigator/altitude_kp")
    node.must("cp -a /opt/swarm /mnt/swarm")
    try:
        node.must(removal)
        assert left(node) == ""
        assert states(node) == {}
        node.must("test -f /etc/swarm/node.toml && test -d /var/lib/swarm && ! ls /usr/bin/swarm*")
    finally:
        node.must("rm -f *.whl; cp /mnt/dist/*.whl .; test -d /opt/swarm || mv /mnt/swarm /opt/")
        for block in section(PAGE, "Install", "uav1"):
            node.must(block)
