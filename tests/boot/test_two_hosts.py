"""share/doc/operations.md on two booted hosts with a network between them, from nothing to a swarm."""

import base64
import json
import re
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import pytest
from tests.boot.machine import Cable, CannotBoot, Machine, wheels, why_not
from tests.boot.page import PAGE, blocks, commands, section
from tests.integration.recorder.mongod import binary

COMMANDS_MAX: Final = 12
"""Commands that a person types on both hosts until `swarmctl node ls` lists both."""
MACHINE_S: Final = 240.0
"""Maximum time of all of them; a person reads within the five minutes, too."""
WAIT_S: Final = 30.0
"""Limit of a wait for an event, for a loaded computer."""

pytestmark = [
    pytest.mark.root,
    pytest.mark.slow,
    pytest.mark.timeout(900),
    pytest.mark.skipif(bool(why_not()), reason=why_not() or "it may"),
]


class Swarm:
    """Two hosts, and the measurements while the page was followed."""

    def __init__(self, cable: Cable, wheel: Path) -> None:
        self.hosts: dict[str, Machine] = {}
        self.network = dict(zip(("gcs", "uav1"), cable.ends, strict=True))
        self.commands = 0
        self.took_s = 0.0
        self.token = ""
        self._wheel = wheel

    def boot(self, name: str, **folders: Path) -> Machine:
        """A fresh host with the wheel in its folder. Raises: CannotBoot."""
        host = Machine(name, self.network[name], dist=self._wheel, wheels=wheels(), **folders)
        self.hosts[name] = host.__enter__()
        host.prepare()
        return host

    def destroy(self, name: str) -> None:
        self.hosts.pop(name).__exit__()

    def copy_out(self, name: str, save: str, folder: Path) -> Path:
        """Types the commands of a backup, and brings its file to a folder of this machine."""
        self.hosts[name].must(save)
        kept = folder / name
        kept.mkdir()
        packed = self.hosts[name].must("base64 backup.tar.gz")
        (kept / "backup.tar.gz").write_bytes(base64.b64decode(packed))
        return kept

    @contextmanager
    def kept(self, host: str, file: str, service: str) -> Iterator[None]:
        """A file of a host that is put back at the end, with a restart of its service."""
        self.hosts[host].must(f"cp --preserve=all {file} kept.toml")
        try:
            yield
        finally:
            self.hosts[host].must(f"mv kept.toml {file}; systemctl restart 'swarmd@{service}'")

    @contextmanager
    def shipped_broker(self) -> Iterator[None]:
        """At the end both have the shipped broker.toml and no firewall."""
        shipped, file = "/opt/swarm/share/swarm/etc/services/broker.toml", "/etc/swarm/services/broker.toml"
        try:
            yield
        finally:
            for host in self.hosts.values():
                host.must(f"systemctl disable --now nftables; nft flush ruleset; cp {shipped} {file}")
                host.must("systemctl restart swarmd@broker")
            self.until(self.both, "both hosts list both nodes")

    def follow(self, heading: str) -> None:
        """Types the commands of a section on their host, or on each host if the page names no host."""
        for block in blocks(PAGE):
            if block.section == heading and not block.reason:
                for name in [block.host] if block.host else list(self.hosts):
                    self.hosts[name].must(block.text)

    def document(self, host: str, command: str) -> Any:
        return json.loads(self.hosts[host].run(f"swarmctl {command} --json").stdout)

    def answering(self, host: str) -> list[str]:
        """Platforms that answer, as `node ls` of this host has it."""
        return [one["platform"] for one in self.document(host, "node ls")["nodes"] if one["answers"]]

    def both(self) -> bool:
        return all(self.answering(name) == ["gcs", "uav1"] for name in self.hosts)

    def until(self, condition: Callable[[], bool], what: str) -> None:
        deadline_s = time.monotonic() + WAIT_S
        while not condition():
            assert time.monotonic() < deadline_s, f"{what}\n{self.diagnosis()}"
            time.sleep(0.3)

    def diagnosis(self) -> str:
        show = "swarmctl node ls || true; swarmctl doctor || true; journalctl --no-pager -u 'swarm*' -n 30"
        return "\n".join(host.run(show).stdout for host in self.hosts.values())

    def warnings(self, host: str) -> list[str]:
        found = self.document(host, "doctor")["results"]
        return [f"{one['check']}: {one['text']}" for one in found if one["verdict"] != "ok"]


def invited(gcs: Machine, command: str) -> tuple["subprocess.Popen[str]", str]:
    """Types an invitation, and reads the line that it prints for the other host."""
    inviter = gcs.begin(command)
    assert inviter.stdout is not None
    for line in inviter.stdout:
        if line.startswith("swarmctl keys join "):
            return inviter, line.strip()
    raise AssertionError(f"{command}: no line for the other host")


def follow_to_the_swarm(swarm: Swarm) -> None:
    """Types the commands of the first section, one after the other."""
    began_s, token, inviter = time.monotonic(), "", None
    steps = [one for heading in ("Install", "Join") for one in blocks(PAGE) if one.section == heading]
    for block in steps:
        host = swarm.hosts[block.host or "gcs"]
        for command in commands(block.text):
            swarm.commands += 1
            if " invite " in command:
                inviter, token = invited(host, command)
            else:
                host.must(re.sub("swarmctl keys join TOKEN", token, command))
    swarm.took_s = time.monotonic() - began_s
    assert inviter is not None
    assert inviter.wait(WAIT_S) == 0, "the invitation ends by itself when it was used"
    inviter.communicate()


@pytest.fixture(scope="module")
def swarm(wheel: Path) -> Iterator[Swarm]:
    """Two hosts on which the first section was followed."""
    with Cable() as cable:
        found = Swarm(cable, wheel)
        try:
            for name in found.network:
                found.boot(name)
            follow_to_the_swarm(found)
            yield found
        except CannotBoot as error:
            pytest.skip(f"no container with systemd here: {error}")
        finally:
            for name in list(found.hosts):
                found.destroy(name)


def test_twelve_commands_turn_two_fresh_hosts_into_swarm(swarm: Swarm) -> None:
    print(f"\n{swarm.commands} commands, {swarm.took_s:.1f} s of machine time")
    assert swarm.commands <= COMMANDS_MAX
    assert swarm.took_s < MACHINE_S
    swarm.until(swarm.both, "both hosts list both nodes")
    swarm.until(lambda: not swarm.warnings("gcs") + swarm.warnings("uav1"), "doctor finds nothing")


def test_the_keys_belong_to_the_daemons_alone(swarm: Swarm) -> None:
    for host in swarm.hosts.values():
        listed = host.must("stat --format='%U %a %n' /etc/swarm/keys /etc/swarm/keys/*").splitlines()
        assert listed[0] == "swarm 700 /etc/swarm/keys"
        assert {line.split()[0] for line in listed} == {"swarm"}
        assert any(re.match(r"swarm 600 .*node\.key$", line) for line in listed)
    assert "uav1" in swarm.hosts["gcs"].must(section(PAGE, "Keys")[0])


def test_seeds_join_without_multicast(swarm: Swarm) -> None:
    with swarm.shipped_broker():
        swarm.follow("Multicast or seeds")
        swarm.until(swarm.both, "both hosts list both nodes")
        links = swarm.document("gcs", "link ls")["neighbours"]
        assert [one["multicast"] for one in links if one["state"] == "up"] == [False]


def test_firewall_of_page_admits_swarm_and_nothing_else(swarm: Swarm) -> None:
    with swarm.shipped_broker():
        swarm.follow("Ports and firewall")
        swarm.until(swarm.both, "both hosts list both nodes")
        port = "7449"
        listen = f"import socket as s; l=s.create_server(('', {port})); print('on', flush=True); l.accept()"
        listening = swarm.hosts["gcs"].begin(f'python3 -c "{listen}"')
        assert listening.stdout is not None and listening.stdout.readline() == "on\n"
        connect = "import socket as s; s.create_connection(('10.0.0.1', {}), 2)"
        swarm.hosts["uav1"].must(f'python3 -c "{connect.format(port)}"')
        assert listening.wait(WAIT_S) == 0
        listening.communicate()
        closed = swarm.hosts["uav1"].run(f'python3 -c "{connect.format(7460)}"')
        assert "timed out" in closed.stderr, "a refusal would be the host's, not the firewall's"


def test_the_clocks_of_both_are_compared(swarm: Swarm) -> None:
    (command,) = section(PAGE, "Time")
    swarm.until(lambda: "uav1" in swarm.hosts["gcs"].run(command).stdout, "the clock of uav1")


def test_the_ground_station_logs_to_a_database(swarm: Swarm, tmp_path: Path) -> None:
    (block,) = section(PAGE, "MongoDB", "gcs")
    gcs = swarm.hosts["gcs"]
    with (
        swarm.kept("gcs", "/etc/swarm/services/logger.toml", "logger"),
        database(swarm.network["gcs"], tmp_path),
    ):
        # the last command asks what is stored: the logger, which has just been restarted, needs a moment
        *commands_before, query = commands(block)
        gcs.must("\n".join(commands_before))
        swarm.until(lambda: "gcs:broker:out" in gcs.run(query).stdout, "entries of gcs in the database")


@contextmanager
def database(network: str, folder: Path) -> Iterator[None]:
    """A real server at 10.0.0.1, in the network of the ground station."""
    words = [
        "--dbpath",
        str(folder),
        "--bind_ip",
        "10.0.0.1",
        "--wiredTigerCacheSizeGB",
        "0.25",
        "--nounixsocket",
    ]
    with (folder / "mongod.txt").open("w+") as log:
        server = subprocess.Popen(
            ["ip", "netns", "exec", network, str(binary()), *words], stdout=log, stderr=log
        )
        try:
            yield
        finally:
            server.terminate()
            server.wait(WAIT_S)


def test_an_upgrade_keeps_the_swarm(swarm: Swarm) -> None:
    for host in swarm.hosts.values():
        host.must("echo '# of the former version' >> /etc/systemd/system/swarmd@.service")
    swarm.follow("Upgrade")
    swarm.until(swarm.both, "both hosts list both nodes")
    for host in swarm.hosts.values():
        assert "former" not in host.must("cat /etc/systemd/system/swarmd@.service")


def test_destroyed_host_is_itself_again_from_its_backup(swarm: Swarm, tmp_path: Path) -> None:
    save, restore = section(PAGE, "Backup and restore")
    swarm.hosts["uav1"].must("swarmctl config set navigator/altitude_kp 1.7")
    key = swarm.hosts["uav1"].must("sha256sum /etc/swarm/keys/node.key")
    for name in ("gcs", "uav1"):
        backup = swarm.copy_out(name, save, tmp_path)
        swarm.destroy(name)
        fresh = swarm.boot(name, backup=backup)
        # the user of the daemons has another number here
        fresh.must("groupadd --system other; useradd --system --gid other other; cp /mnt/backup/* .")
        fresh.must(restore)
        swarm.until(swarm.both, "both hosts list both nodes")
        swarm.until(lambda name=name: not swarm.warnings(name), "doctor finds nothing")  # type: ignore[misc]
    assert swarm.hosts["uav1"].must("sha256sum /etc/swarm/keys/node.key") == key
    assert "1.7" in swarm.hosts["uav1"].must("swarmctl config get navigator/altitude_kp")
    swarm.hosts["gcs"].must("swarmctl keys rotate")  # the root is there again
    swarm.hosts["uav1"].must("swarmctl config set navigator/altitude_kp --default")


def test_revoked_node_is_refused_until_new_invitation(swarm: Swarm) -> None:
    gcs, uav1 = swarm.hosts["gcs"], swarm.hosts["uav1"]
    symptom = symptoms()["all other nodes ignore this node"]
    try:
        gcs.must("swarmctl keys revoke uav1 --yes")
        swarm.until(lambda: swarm.answering("gcs") == ["gcs"], "gcs serves uav1 no more")
        swarm.until(lambda: symptom.text in uav1.run(symptom.command).stdout, symptom.symptom)
    finally:
        inviter, line = invited(gcs, "swarmctl keys invite uav1")
        uav1.must("systemctl stop swarm.target 'swarmd@*'")
        uav1.must(f"{line} --replace")
        uav1.must("systemctl start swarm.target")
        inviter.communicate(timeout=WAIT_S)
    swarm.until(swarm.both, "both hosts list both nodes")


# -- symptoms


class Symptom(NamedTuple):
    """One line of the table of symptoms."""

    symptom: str
    command: str
    text: str
    """What its output has."""


def symptoms() -> dict[str, Symptom]:
    """The lines of the table, by their first words without the marks of code."""
    table = PAGE.read_text().partition("## Symptoms")[2].partition("###")[0]
    rows = [
        [cell.strip() for cell in line.split(" | ")] for line in table.splitlines() if line.startswith("| ")
    ]
    found = [
        Symptom(row[0].removeprefix("| ").replace("`", ""), row[1].strip("`"), row[2].strip("`"))
        for row in rows[1:]
    ]
    return {one.symptom: one for one in found}


@contextmanager
def without_keys(swarm: Swarm, more: str = "true") -> Iterator[None]:
    """The node of uav1 runs without its keys."""
    uav1, stop, keys = swarm.hosts["uav1"], "systemctl stop swarm.target 'swarmd@*'", "/etc/swarm/keys"
    uav1.must(f"{stop}; mv {keys} kept; mkdir -m 700 {keys}; chown swarm: {keys}; {more}")
    uav1.must("systemctl start swarm.target")
    try:
        yield
    finally:
        uav1.must(f"{stop}; rm -rf {keys} /root/other; mv kept {keys}; systemctl start swarm.target")


@contextmanager
def former_key(swarm: Swarm) -> Iterator[None]:
    """The card of uav1 was restored: its keys are those from before it joined again."""
    uav1, stop, keys = swarm.hosts["uav1"], "systemctl stop swarm.target 'swarmd@*'", "/etc/swarm/keys"
    inviter, line = invited(swarm.hosts["gcs"], "swarmctl keys invite uav1")
    uav1.must(f"{stop}; cp -a {keys} former; {line} --replace")
    inviter.communicate(timeout=WAIT_S)
    uav1.must(f"mv {keys} kept; mv former {keys}; systemctl start swarm.target")
    try:
        yield
    finally:
        uav1.must(f"{stop}; rm -rf {keys}; mv kept {keys}; systemctl start swarm.target")


@contextmanager
def ended_invitation(swarm: Swarm) -> Iterator[None]:
    with without_keys(swarm):
        inviter, line = invited(swarm.hosts["gcs"], "timeout --signal=INT 10 swarmctl keys invite uav1")
        inviter.communicate(timeout=WAIT_S)
        swarm.token = line.split()[-1]
        yield


@contextmanager
def silent_network(swarm: Swarm) -> Iterator[None]:
    rules = "table inet deaf { chain input { type filter hook input priority 0; iif != lo drop; }; }"
    swarm.hosts["gcs"].must(f"nft '{rules}'")
    try:
        yield
    finally:
        swarm.hosts["gcs"].must("nft delete table inet deaf")


@contextmanager
def damaged_file(swarm: Swarm) -> Iterator[None]:
    with swarm.kept("uav1", "/etc/swarm/services/timesync.toml", "timesync"):
        swarm.hosts["uav1"].must("echo 'nonsense = 1' >> /etc/swarm/services/timesync.toml")
        swarm.hosts["uav1"].must("systemctl --no-block restart swarmd@timesync")
        yield


@contextmanager
def no_database(swarm: Swarm) -> Iterator[None]:
    with swarm.kept("uav1", "/etc/swarm/services/logger.toml", "logger"):
        uav1 = swarm.hosts["uav1"]
        uav1.must('/opt/swarm/bin/pip install "$(ls swarmware-*.whl)[mongo]"')
        file = "/etc/swarm/services/logger.toml"
        uav1.must(f"sed -i 's|^mongodb_uri = .*|mongodb_uri = \"mongodb://10.0.0.1:27017\"|' {file}")
        uav1.must("systemctl restart swarmd@logger")
        yield


@contextmanager
def wrong_clock(swarm: Swarm) -> Iterator[None]:
    with swarm.kept("uav1", "/etc/swarm/node.toml", "*"):
        swarm.hosts["uav1"].must("sed -i 's/^offset_s = .*/offset_s = 30.0/' /etc/swarm/node.toml")
        swarm.hosts["uav1"].must("systemctl restart 'swarmd@*'")
        yield


@contextmanager
def former_unit(swarm: Swarm) -> Iterator[None]:
    swarm.hosts["uav1"].must("echo '# former' >> /etc/systemd/system/swarmd@.service")
    yield
    swarm.hosts["uav1"].must("swarmctl host install")


@contextmanager
def stranger(swarm: Swarm) -> Iterator[None]:
    swarm.hosts["uav1"].must("id olga || useradd --create-home --shell /bin/bash olga")
    yield


PROVOKED: Final[dict[str, tuple[Callable[[Swarm], AbstractContextManager[None]], str, str]]] = {
    "node ls shows only this node; the node is new": (without_keys, "uav1", ""),
    "node ls misses a node that runs": (silent_network, "gcs", ""),
    "two nodes do not see each other, and have keys of two swarms": (
        lambda swarm: without_keys(swarm, "swarmctl keys init --root /root/other"),
        "gcs",
        "",
    ),
    "a node was restored from an old backup, or its key belongs to another computer": (
        former_key,
        "uav1",
        "",
    ),
    "no inviter answers of keys join": (ended_invitation, "uav1", ""),
    "a service is missing in app ls": (damaged_file, "uav1", ""),
    "a unit is activating, again and again": (damaged_file, "uav1", ""),
    "a user may not use swarmctl": (stranger, "uav1", "olga"),
    "the database gets no new entries": (no_database, "uav1", ""),
    "times in the logs of two nodes differ": (wrong_clock, "gcs", ""),
    "the host was upgraded and units differ": (former_unit, "uav1", ""),
}
"""Cause of each symptom, the host of its command, and the user who types it, or "" for root."""


def test_every_symptom_is_provoked() -> None:
    assert set(symptoms()) == {*PROVOKED, "all other nodes ignore this node"}


@pytest.mark.parametrize("name", PROVOKED)
def test_the_command_of_a_symptom_names_its_cause(swarm: Swarm, name: str) -> None:
    symptom, (provoke, place, user) = symptoms()[name], PROVOKED[name]

    def seen() -> bool:
        done = swarm.hosts[place].run(symptom.command.replace("TOKEN", swarm.token), user)
        return symptom.text in done.stdout + done.stderr

    with provoke(swarm):
        swarm.until(seen, f"{symptom.command}: {symptom.text}")
    swarm.until(swarm.both, "both hosts list both nodes again")
