"""`swarmctl host`: steps that set a computer up, in a folder that stands for its files."""

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.host import installing, removing
from swarmctl.installation import configuration, plan
from swarmctl.installation.configuration import NodeChoice, host_node, with_keys
from swarmctl.installation.host import Host
from swarmctl.installation.package import InstalledPackage
from swarmctl.installation.plan import CONFIG, install_steps, removal_steps, units_of
from swarmctl.installation.step import HostStep, StepAction, run
from swarmctl.main import main as swarmctl
from swarmctl.session.session import connect
from swarmctl.terminal.output import Output
from swarmlab.provision.node_files import STATION, VEHICLE
from swarmware.errors import ConfigError, Conflict, Denied, InvalidInput, NotFound, SwarmError
from swarmware.model.config import NodeConfig, load
from swarmware.testing.tmpnode import make_node

PACKAGE = InstalledPackage(Path("/opt/swarm/bin"), InstalledPackage.find().share)
SERVICES = NodeConfig().services
NOT_AT_A_STATION = set(VEHICLE) - set(STATION)


class FakeHost(Host):
    """Files below a folder; programs are recorded, and the few that matter have their effect."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self.ran: list[tuple[str, ...]] = []
        self.users: dict[str, tuple[int, int]] = {}
        self.members: set[str] = set()
        self.active: set[str] = set()

    def user(self, name: str) -> tuple[int, int] | None:
        return self.users.get(name)

    def is_member(self, user: str, group: str) -> bool:
        if user not in self.users:
            raise NotFound(f"user {user!r}")
        return user in self.members

    def states(self, units: Sequence[str]) -> dict[str, str]:
        return {unit: "active" if unit in self.active else "inactive" for unit in units}

    def run(self, words: Sequence[str]) -> str:
        self.ran.append(tuple(words))
        match [word for word in words if not word.startswith("--")]:
            case ["systemd-sysusers", *_]:
                stat = self.place("/").stat()
                self.users["swarm"] = stat.st_uid, stat.st_gid
            case ["systemd-tmpfiles", *_]:
                for folder in ("/run/swarm", "/etc/swarm/keys", "/var/lib/swarm"):
                    self.place(folder).mkdir(parents=True, exist_ok=True)
            case ["systemctl", "enable", *units]:
                for unit in units:
                    link = self._wants(unit)
                    link.parent.mkdir(parents=True, exist_ok=True)
                    link.symlink_to("/unit")
            case ["systemctl", "disable", *units]:
                for unit in units:
                    self._wants(unit).unlink()
                self.active -= set(units)
            case ["systemctl", "start", *units]:
                self.active |= set(units)
            case ["usermod", _, "swarm", user] | ["usermod", "swarm", user]:
                self.members.add(user)
        return ""

    def _wants(self, unit: str) -> Path:
        return self.place(f"{plan.DAEMONS if unit.startswith('swarmd@') else plan.AT_BOOT}/{unit}")

    def install(
        self, choice: NodeChoice | None = None, *operators: str, start: bool = True
    ) -> list[HostStep]:
        """Carries out what is missing, and returns it."""
        node = host_node(PACKAGE.configuration, self.place(CONFIG), choice or NodeChoice("uav1"))
        return list(self.carry_out(install_steps(self, PACKAGE, node, operators, start=start)))

    def config(self, name: str) -> dict[str, Any]:
        return tomllib.loads(self.place(f"{CONFIG}/{name}").read_text())

    def remains(self) -> list[str]:
        """Files and links, without folders."""
        root = self.place("/")
        return sorted(
            f"/{one.relative_to(root)}" for one in root.rglob("*") if not one.is_dir() or one.is_symlink()
        )


@pytest.fixture
def fresh(tmp_path: Path) -> FakeHost:
    return FakeHost(tmp_path)


def commands(steps: list[HostStep]) -> list[str]:
    return [step.target for step in steps if step.action == StepAction.RUN]


def test_fresh_host_is_set_up_in_one_call(fresh: FakeHost) -> None:
    fresh.install()
    units = ["swarm.target", *(f"swarmd@{name}.service" for name in SERVICES)]
    assert fresh.ran[0] == ("systemd-sysusers", "swarm.conf")
    assert fresh.ran[-3:] == [
        ("systemctl", "daemon-reload"),
        ("systemctl", "enable", "--quiet", *units),
        ("systemctl", "start", *units),
    ]
    assert fresh.link("/usr/bin/swarmctl") == "/opt/swarm/bin/swarmctl"
    for unit in ("swarmd@.service", "swarm.target", "swarm-node.service"):
        assert fresh.content(f"/etc/systemd/system/{unit}") == (PACKAGE.units / unit).read_bytes()
    assert fresh.content(plan.RULES) == (PACKAGE.units / "swarm.rules").read_bytes()
    assert fresh.install() == []


def test_interrupted_installation_is_completed_by_next(tmp_path: Path) -> None:
    whole = FakeHost(tmp_path / "whole")
    whole.place("/").mkdir()
    count = len(whole.install())
    for done in range(count):
        half = FakeHost(tmp_path / str(done))
        half.place("/").mkdir()
        node = host_node(PACKAGE.configuration, half.place(CONFIG), NodeChoice("uav1"))
        steps = half.carry_out(install_steps(half, PACKAGE, node, (), start=True))
        for _ in range(done):
            next(steps)
        half.install()
        assert half.remains() == whole.remains(), done
        assert half.active == whole.active, done
        assert half.install() == [], done


@pytest.mark.parametrize(
    ("name", "kind", "template", "left_out"),
    [
        ("uav1", "uav", "multirotor", set()),
        ("ugv12", "ugv", "ugv", set()),
        ("usv", "usv", "usv", set()),
        ("gcs", "gcs", "gcs", NOT_AT_A_STATION),
        ("gcs_2", "gcs", "gcs", NOT_AT_A_STATION),
    ],
)
def test_the_name_of_a_platform_has_its_kind(
    fresh: FakeHost, name: str, kind: str, template: str, left_out: set[str]
) -> None:
    fresh.install(NodeChoice(name))
    node = load(fresh.place(f"{CONFIG}/node.toml"), NodeConfig)
    assert (node.platform, str(node.kind.value), node.template) == (name, kind, template)
    assert (node.processes, fresh.config("services/guard.toml")["supervisor"]) == ("per-daemon", "systemd")
    assert set(SERVICES) - set(node.services) == left_out
    drivers = fresh.config("services/hal.toml")["drivers"]
    assert ("sim" in drivers) == (not left_out) and "system" in drivers
    assert fresh.active == {"swarm.target", *(f"swarmd@{one}.service" for one in node.services)}
    assert fresh.place(f"{CONFIG}/node.toml").read_text().count("\n# ") > 5, "its comments are those shipped"


def test_options_take_the_place_of_the_name(fresh: FakeHost) -> None:
    fresh.install(NodeChoice("base", kind="ugv", template="vehicle", real=True))
    node = load(fresh.place(f"{CONFIG}/node.toml"), NodeConfig)
    assert (node.platform, str(node.kind.value), node.template) == ("base", "ugv", "vehicle")
    assert "sim" not in node.services and "navigator" in node.services
    assert "sim" not in fresh.config("services/hal.toml")["drivers"]


def test_further_computer_gets_name_and_common_files(fresh: FakeHost) -> None:
    fresh.install(NodeChoice("uav1", unit="fc"))
    node = load(fresh.place(f"{CONFIG}/node.toml"), NodeConfig)
    assert (node.platform, node.unit) == ("uav1", "fc")
    assert set(node.services) == set(configuration.UNIT)
    assert set(node.services) < set(SERVICES)
    fresh.install(NodeChoice("uav1", unit="fc"))


@pytest.mark.parametrize(
    ("choice", "expected"),
    [(NodeChoice(), "--name"), (NodeChoice("base"), "--kind"), (NodeChoice("UAV 1"), "expected \\[a-z\\]")],
)
def test_new_node_needs_name_and_kind(fresh: FakeHost, choice: NodeChoice, expected: str) -> None:
    with pytest.raises(InvalidInput, match=expected):
        fresh.install(choice)
    assert fresh.remains() == []


@pytest.mark.parametrize(
    "choice",
    [
        NodeChoice("uav2"),
        NodeChoice(kind="ugv"),
        NodeChoice(template="gcs"),
        NodeChoice(real=True),
        NodeChoice(single_unit=True),
        NodeChoice(unit="fc"),
    ],
)
def test_an_option_that_contradicts_a_file_is_refused(fresh: FakeHost, choice: NodeChoice) -> None:
    fresh.install()
    before = fresh.remains()
    with pytest.raises(Conflict, match=r"expected .*: edit the file"):
        fresh.install(choice)
    assert fresh.remains() == before


def test_a_file_that_was_changed_by_hand_stays(fresh: FakeHost) -> None:
    broker = fresh.place(f"{CONFIG}/services/broker.toml")
    broker.parent.mkdir(parents=True)
    broker.write_text("udp_port = 7000\n")
    fresh.install()
    assert broker.read_text() == "udp_port = 7000\n"
    assert fresh.install(NodeChoice()) == [], "the name is that of the file"


def test_units_follow_the_services_of_node_toml(fresh: FakeHost) -> None:
    fresh.install()
    file = fresh.place(f"{CONFIG}/node.toml")
    file.write_bytes(with_keys(file.read_bytes(), {"services": ["broker", "guard", "lookout"]}, "node.toml"))
    ran = commands(fresh.install())
    assert ran[0].startswith("systemctl disable --quiet --now swarmd@")
    assert "swarmd@tree.service" in ran[0] and "swarmd@broker.service" not in ran[0]
    assert ran[1:] == [
        "systemctl enable --quiet swarmd@lookout.service",
        "systemctl start swarmd@lookout.service",
    ]
    assert fresh.active == {
        "swarm.target",
        *(f"swarmd@{one}.service" for one in ("broker", "guard", "lookout")),
    }


def test_node_switches_between_one_unit_and_many(fresh: FakeHost) -> None:
    fresh.install(NodeChoice("uav1", single_unit=True))
    assert fresh.active == {"swarm-node.service"}
    assert fresh.config("node.toml")["processes"] == "one"
    guard = fresh.place(f"{CONFIG}/services/guard.toml")
    guard.write_bytes(with_keys(guard.read_bytes(), {"supervisor": "systemd"}, "guard.toml"))
    fresh.install()
    assert "swarm-node.service" not in fresh.active and "swarm.target" in fresh.active
    guard.write_bytes(with_keys(guard.read_bytes(), {"supervisor": "self"}, "guard.toml"))
    fresh.install()
    assert fresh.active == {"swarm-node.service"}


def test_units_of_an_earlier_version_are_replaced(fresh: FakeHost) -> None:
    fresh.install()
    fresh.place("/etc/systemd/system/swarmd@.service").write_text("[Unit]\n")
    assert [step.target for step in fresh.install()] == [
        "/etc/systemd/system/swarmd@.service",
        "systemctl daemon-reload",
    ]


def test_backup_files_belong_to_user_of_host(fresh: FakeHost) -> None:
    fresh.install()
    fresh.place(f"{CONFIG}/services/logger.toml").chmod(0o640)
    fresh.users["swarm"] = 64_000, 64_000  # the number that the user got here
    assert commands(fresh.install()) == [
        "chown --recursive swarm:swarm /etc/swarm/keys",
        "chown --recursive swarm:swarm /var/lib/swarm",
        "chgrp swarm /etc/swarm/services/logger.toml",
    ]


def test_operators_become_members_of_the_group_once(fresh: FakeHost) -> None:
    fresh.users["anna"] = 1000, 1000
    assert "usermod --append --groups swarm anna" in commands(fresh.install(NodeChoice("uav1"), "anna"))
    assert fresh.install(NodeChoice(), "anna") == []
    with pytest.raises(NotFound, match="nobody_here"):
        fresh.install(NodeChoice(), "nobody_here")


def test_unstarted_node_starts_at_next_boot(fresh: FakeHost) -> None:
    fresh.install(start=False)
    assert fresh.active == set()
    assert plan.enabled_units(fresh)
    assert fresh.install(start=False) == []


def test_programs_of_another_origin_are_not_replaced(fresh: FakeHost) -> None:
    file = fresh.place("/usr/bin/swarmd")
    file.parent.mkdir(parents=True)
    file.write_text("#!/bin/sh\n")
    with pytest.raises(Conflict, match="another installation"):
        fresh.install()
    file.unlink()
    file.symlink_to("/opt/former/bin/swarmd")
    fresh.install()
    assert fresh.link("/usr/bin/swarmd") == "/opt/swarm/bin/swarmd"


def test_removal_is_reverse_and_keeps_what_is_operators(fresh: FakeHost) -> None:
    fresh.install()
    fresh.place("/etc/systemd/system/own.service").write_text("[Unit]\n")
    fresh.place("/var/lib/swarm/settings.toml").write_text("")
    removed = list(fresh.carry_out(removal_steps(fresh, PACKAGE, "/var/lib/swarm", purge=False)))
    assert removed[0].target.startswith("systemctl disable --quiet --now swarmd@")
    assert fresh.active == set()
    left = fresh.remains()
    assert "/etc/systemd/system/own.service" in left and "/var/lib/swarm/settings.toml" in left
    assert [one for one in left if not one.startswith(("/etc/swarm/", "/var/lib/swarm/"))] == [
        "/etc/systemd/system/own.service"
    ]
    assert removal_steps(fresh, PACKAGE, "/var/lib/swarm", purge=False) == []
    purge = list(fresh.carry_out(removal_steps(fresh, PACKAGE, "/var/lib/swarm", purge=True)))
    assert [step.target for step in purge][:3] == ["/etc/swarm", "/var/lib/swarm", "userdel swarm"]
    assert "groupdel swarm" in purge[3].target
    assert fresh.remains() == ["/etc/systemd/system/own.service"]


def test_removal_leaves_programs_of_another_environment(fresh: FakeHost) -> None:
    fresh.install()
    other = InstalledPackage(Path("/opt/other/bin"), PACKAGE.share)
    list(fresh.carry_out(removal_steps(fresh, other, "/var/lib/swarm", purge=False)))
    assert fresh.link("/usr/bin/swarmd") == "/opt/swarm/bin/swarmd"


def test_program_that_fails_ends_steps_with_its_message(tmp_path: Path) -> None:
    real = Host(tmp_path)
    steps = [run("fails", "sh", "-c", "echo no such unit >&2; exit 5"), run("is not reached", "true")]
    with pytest.raises(SwarmError, match=r"sh -c .*: no such unit"):
        list(real.carry_out(steps))
    with pytest.raises(NotFound, match="not installed"):
        real.run(["systemctl-of-nothing"])


def test_without_root_or_systemd_nothing_is_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    with pytest.raises(Denied, match="sudo swarmctl host install"):
        Host(tmp_path).check_ready("host install")
    monkeypatch.setattr("os.geteuid", lambda: 0)
    with pytest.raises(NotFound, match="systemd does not run here"):
        Host(tmp_path).check_ready("host install")
    (tmp_path / "run/systemd/system").mkdir(parents=True)
    Host(tmp_path).check_ready("host install")


def test_an_environment_that_the_units_hide_is_refused() -> None:
    with pytest.raises(InvalidInput, match="such as /opt/swarm"):
        InstalledPackage(Path("/home/anna/venv/bin"), Path("/usr/share")).check_visible()


def test_environment_that_is_closed_to_daemons_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmctl.installation.package.HIDDEN", ())
    closed = tmp_path / "closed"
    (closed / "bin").mkdir(parents=True)
    closed.chmod(0o700)
    with pytest.raises(InvalidInput, match=r"closed: closed to the user of the daemons"):
        InstalledPackage(closed / "bin", closed / "bin").check_visible()


def test_key_unknown_to_shipped_file_is_error() -> None:
    text = b'# a\nname = "a"\n[table]\nname = "b"\n'
    assert with_keys(text, {"name": "c"}, "x") == b'# a\nname = "c"\n[table]\nname = "b"\n'
    with pytest.raises(ConfigError, match="no line `other = …`"):
        with_keys(b'name = "a"\n', {"other": 1}, "x.toml")


def test_dry_run_prints_steps_and_needs_no_rights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fake = FakeHost(tmp_path)
    for module in (installing, removing):
        monkeypatch.setattr(module, "Host", lambda: fake)
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    out = Output(CliSettings())
    installing.install_node(out, NodeChoice("uav1"), (), start=True, dry_run=True)
    assert "/etc/systemd/system/swarmd@.service" in capsys.readouterr().out
    removing.remove_node(out, purge=True, force=False, yes=False, dry_run=True)
    with pytest.raises(Denied):
        installing.install_node(out, NodeChoice("uav1"), (), start=True, dry_run=False)
    assert fake.remains() == [] and fake.ran == []


@pytest.fixture
def remote(fresh: FakeHost, monkeypatch: pytest.MonkeyPatch) -> FakeHost:
    """A host on which `fleet push` has written a node.toml."""
    monkeypatch.setattr(fresh, "check_ready", lambda what: None)
    monkeypatch.setattr(InstalledPackage, "check_visible", lambda package: None)
    file = fresh.place(f"{CONFIG}/node.toml")
    file.parent.mkdir(parents=True)
    file.write_text('platform = "uav1"\nservices = ["broker", "guard"]\n')
    return fresh


@pytest.mark.parametrize(
    "words",
    [
        ("--name", "uav1"),
        ("--name", "uav1", "--unit", "fc"),
        ("--name", "base", "--kind", "gcs", "--single-unit", "--real"),
    ],
)
def test_the_command_line_reaches_the_plan(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
) -> None:
    monkeypatch.setattr(installing, "Host", lambda: FakeHost(tmp_path))
    monkeypatch.setattr(installing, "CONFIG", str(tmp_path / "etc/swarm"))
    assert swarmctl(["host", "install", "--dry-run", "--json", *words]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["platform"], found["dry_run"]) == (words[1], True)
    assert (found["units"] == ["swarm-node.service"]) == ("--single-unit" in words)
    assert swarmctl(["host", "install", "--dry-run"]) == 7
    assert "--name" in capsys.readouterr().err


async def test_user_without_access_to_node_is_guided(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config_dir = make_node(tmp_path)
    run_path = load(config_dir / "node.toml", NodeConfig).run_path
    run_path.mkdir(exist_ok=True)
    monkeypatch.setattr("os.access", lambda path, mode: path != run_path)
    with pytest.raises(Denied, match=r"a member of its group .*swarmctl host install --operator NAME"):
        async with connect(CliSettings(config=str(config_dir))):
            pass


def test_fleet_sets_host_up_before_starting_unit(remote: FakeHost) -> None:
    plan.start_unit("swarm.target", Path(CONFIG), remote)
    assert remote.active == {"swarm.target", "swarmd@broker.service", "swarmd@guard.service"}
    assert remote.content(plan.RULES)
    assert remote.config("services/guard.toml")["supervisor"] == "systemd"
    with pytest.raises(Conflict, match='expected "self" for one unit'):
        plan.start_unit("swarm-node.service", Path(CONFIG), remote)


def test_fleet_refuses_guard_that_duplicates_daemons(remote: FakeHost) -> None:
    guard = remote.place(f"{CONFIG}/services/guard.toml")
    guard.parent.mkdir()
    guard.write_text('supervisor = "self"\n')
    with pytest.raises(Conflict, match=r'expected "systemd" for unit swarm\.target'):
        plan.start_unit("swarm.target", Path(CONFIG), remote)
    plan.start_unit("swarm-node.service", Path(CONFIG), remote)
    assert remote.active == {"swarm-node.service"}


@pytest.mark.parametrize(("unit", "folder"), [("my-node.service", CONFIG), ("swarm.target", "/srv/uav1")])
def test_fleet_only_starts_unit_that_is_not_shipped(remote: FakeHost, unit: str, folder: str) -> None:
    plan.start_unit(unit, Path(folder), remote)
    assert remote.ran == [("systemctl", "enable", unit), ("systemctl", "start", unit)]


def test_units_of_node_are_those_of_swarmd_units() -> None:
    node = configuration.HostNode("uav1", ("broker", "tree"), "/var/lib/swarm", False, {})
    assert units_of(node) == ("swarm.target", "swarmd@broker.service", "swarmd@tree.service")
