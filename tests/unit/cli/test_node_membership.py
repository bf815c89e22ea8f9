"""`swarmctl node add`, `remove` and `rename`: files of this computer, refusals, and what stays."""

import time
from pathlib import Path
from typing import Any

import pytest
from tests.unit.cli.invitation import WAIT_S, Station, inviting_at, plan
from tests.unit.cli.session import ScriptedSession

from swarmctl.commands.keys.listing import list_members
from swarmctl.commands.keys.making import make_root
from swarmctl.commands.node.adding import NewNode, add_node
from swarmctl.commands.node.removing import Removal, forget_at
from swarmctl.commands.node.renaming import Renaming, renamed
from swarmctl.membership import changing
from swarmctl.membership.hosts import read_hosts
from swarmctl.membership.hosts_file import add_host, remove_hosts, rename_host
from swarmctl.membership.inviting import InvitationPlan, invite_nodes
from swarmctl.membership.joining import join
from swarmctl.membership.node_keys import NodeKeys
from swarmctl.membership.root_folder import RootFolder
from swarmware.errors import Conflict, Denied, InvalidInput, NoAnswer, NotFound, SwarmError
from swarmware.testing.tmpnode import make_node
from swarmware.transport.security.keys import Keys
from swarmware.transport.security.root import Root
from swarmware.types.health import FaultList
from swarmware.types.mission import MissionPhase, MissionState, MissionStatus
from swarmware.types.register import PlatformRemoved

HOSTS = """# the fleet of the harbour
[defaults]
user = "pi"  # everywhere

[[hosts]]
name = "uav1"   # the first
address = "10.0.0.1"
[hosts.node]
kind = "uav"

# spare
[[hosts]]
name = 'uav2'
address = "10.0.0.2"
"""


@pytest.fixture(autouse=True)
def no_usual_root(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "home"))


@pytest.fixture
def hosts(tmp_path: Path) -> Path:
    path = tmp_path / "HOSTS.toml"
    path.write_text(HOSTS)
    return path


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return tmp_path / "root"


@pytest.fixture
def base(tmp_path: Path, root: Path) -> Station:
    station = Station(make_node(tmp_path, "gcs"))
    make_root(station, root, "harbour")
    return station


@pytest.fixture
def vehicle(tmp_path: Path, base: Station, root: Path) -> Station:
    """A member, stopped."""
    station = Station(make_node(tmp_path, "uav1"))
    with inviting_at(base, root, plan()) as token:
        join(station, token("uav1"), None, replace=False)
    return station


def renaming(station: Station, new: str, root: Path | None = None, token: str = "", **more: Any) -> None:
    Renaming(station, more.pop("former", "uav1"), new).run(token, root, more.pop("hosts", None), yes=True)


def test_host_changes_leave_other_text_unchanged(hosts: Path) -> None:
    assert add_host(hosts, "uav3", "10.0.0.3", {"kind": "ugv", "template": "ugv"})
    assert hosts.read_text().startswith(HOSTS)
    assert read_hosts(hosts)[2].node == {"kind": "ugv", "template": "ugv", "platform": "uav3"}
    assert rename_host(hosts, "uav1", "scout")
    assert rename_host(hosts, "uav2", "spare")
    assert remove_hosts(hosts, ("uav3", "uav9")) == ["uav3"]
    expected = HOSTS.replace('"uav1"', '"scout"').replace("'uav2'", '"spare"')
    assert hosts.read_text().rstrip() == expected.rstrip()
    assert not rename_host(hosts, "uav9", "uav8")


def test_host_added_again_must_have_same_address(
    hosts: Path,
) -> None:
    assert not add_host(hosts, "uav2", "10.0.0.2", {})
    assert hosts.read_text() == HOSTS
    with pytest.raises(Conflict, match=r"uav2.*10\.0\.0\.2"):
        add_host(hosts, "uav2", "10.0.0.9", {})


def test_new_hosts_file_keeps_its_last_host(tmp_path: Path) -> None:
    path = tmp_path / "new.toml"
    assert add_host(path, "uav1", "10.0.0.1", {})
    assert [host.name for host in read_hosts(path)] == ["uav1"]
    with pytest.raises(InvalidInput, match="no host would remain"):
        remove_hosts(path, ("uav1",))


def test_hosts_in_line_are_not_changed_by_guessing(tmp_path: Path) -> None:
    path = tmp_path / "line.toml"
    text = 'hosts = [{name = "uav1", address = "a"}, {name = "uav2", address = "b"}]\n'
    path.write_text(text)
    for change in (lambda: remove_hosts(path, ("uav2",)), lambda: rename_host(path, "uav2", "uav3")):
        with pytest.raises(InvalidInput, match="by hand"):
            change()
    assert path.read_text() == text


def test_node_is_added_to_file_and_to_swarm(base: Station, root: Path, hosts: Path, tmp_path: Path) -> None:
    file = tmp_path / "uav3.join"
    new = NewNode("uav3", "10.0.0.3", "ugv")
    add_node(base, new, InvitationPlan(("uav3",), "node", WAIT_S, "", str(file)), root, hosts)
    assert read_hosts(hosts)[2].address == "10.0.0.3"
    member = Root.load(root).roster.find("uav3")
    assert member is not None and member.role == "node"
    station = Station(make_node(tmp_path, "uav3"))
    join(station, base.stdout.getvalue().splitlines()[-1].split()[3], file, replace=False)
    assert station.keys("uav3").sign_public_of("gcs") == base.keys("gcs").sign_public_of("gcs")


def test_a_name_that_is_taken_is_not_added(base: Station, vehicle: Station, root: Path, hosts: Path) -> None:
    with pytest.raises(Conflict, match="uav1: a member of the swarm has this name"):
        add_node(base, NewNode("uav1", "10.0.0.9"), plan("uav1"), root, hosts)
    assert hosts.read_text() == HOSTS


def test_contradicting_options_of_an_addition_change_nothing(base: Station, root: Path, hosts: Path) -> None:
    for new, file in (
        (NewNode("uav3", "10.0.0.3"), None),
        (NewNode("uav3"), hosts),
        (NewNode("uav3", "", "uav"), None),
    ):
        with pytest.raises(InvalidInput, match="expected"):
            add_node(base, new, plan("uav3"), root, file)
    assert hosts.read_text() == HOSTS
    assert Root.load(root).roster.find("uav3") is None


def test_node_without_keys_joins_file_only(tmp_path: Path, hosts: Path) -> None:
    station = Station(make_node(tmp_path, "gcs"))
    add_node(station, NewNode("uav3", "10.0.0.3"), plan("uav3"), None, hosts)
    assert [host.name for host in read_hosts(hosts)] == ["uav1", "uav2", "uav3"]
    assert "no keys" in station.stderr.getvalue()
    with pytest.raises(NotFound, match="no keys"):
        add_node(station, NewNode("uav4"), plan("uav4"), None, None)


def test_renamed_node_keeps_key_role_and_files(
    vehicle: Station, base: Station, root: Path, hosts: Path
) -> None:
    path = Path(vehicle.settings.config) / "node.toml"
    path.write_text("# the first\n" + path.read_text() + "\n[clock]\ndrift_ppm = 1.0\n")
    before = vehicle.keys("uav1")
    renaming(vehicle, "scout", root, hosts=hosts)
    node = NodeKeys.find(vehicle.settings)
    assert node.platform == "scout" and node.node.data_dir.endswith("/uav1/data")
    assert path.read_text().startswith("# the first\n")
    after = vehicle.keys("scout")
    assert after.curve_public == before.curve_public
    roster = Root.load(root).roster
    assert [(one.platform, one.role) for one in roster.valid()] == [("gcs", "maintainer"), ("scout", "node")]
    assert [host.name for host in read_hosts(hosts)] == ["scout", "uav2"]
    assert "forgets the name uav1" in vehicle.stderr.getvalue()
    with pytest.raises(SwarmError):
        vehicle.keys("uav1")


def test_node_is_renamed_by_token_without_root(vehicle: Station, base: Station, root: Path) -> None:
    before = vehicle.keys("uav1").curve_public
    with inviting_at(base, root, plan("scout")) as token:
        renaming(vehicle, "scout", token=token("scout"))
    assert vehicle.keys("scout").curve_public == before
    assert [one.platform for one in Root.load(root).roster.valid()] == ["gcs", "scout"]


def test_an_interrupted_renaming_is_repeated(
    vehicle: Station, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(NodeKeys, "replace_roster", lambda *_: (_ for _ in ()).throw(OSError("full")))
        with pytest.raises(OSError, match="full"):
            renaming(vehicle, "scout", root)
    renaming(vehicle, "scout", root)
    assert vehicle.keys("scout").platform == "scout"
    assert [one.platform for one in Root.load(root).roster.valid()] == ["gcs", "scout"]


def test_taken_or_invalid_name_is_refused_first(
    vehicle: Station, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    signed = Root.load(root).signed
    for new, former, kind in (
        ("gcs", "uav1", Conflict),
        ("uav1", "uav1", InvalidInput),
        ("uav7", "uav9", NotFound),
    ):
        with pytest.raises(kind):
            renaming(vehicle, new, root, former=former)
    with monkeypatch.context() as patch:
        patch.setattr(NodeKeys, "runs", True)
        with pytest.raises(Conflict, match="uav1 runs; expected a stopped node"):
            renaming(vehicle, "scout", root)
    assert Root.load(root).signed == signed
    assert vehicle.keys("uav1").platform == "uav1"


def test_node_without_keys_is_renamed_by_its_file(tmp_path: Path) -> None:
    station = Station(make_node(tmp_path, "uav1"))
    renaming(station, "scout")
    assert NodeKeys.find(station.settings).platform == "scout"
    assert "`swarmctl node remove uav1`" in station.stderr.getvalue()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('platform = "uav1"  # mine\n', 'platform = "scout"  # mine\n'),
        ("platform='uav1'\n", 'platform="scout"\n'),
        ('unit = "fc"\n', 'platform = "scout"\nunit = "fc"\n'),
    ],
)
def test_only_the_name_in_a_node_file_changes(text: str, expected: str) -> None:
    assert renamed(text, "scout", "node.toml") == expected


def test_one_key_has_one_name(root: Path, vehicle: Station) -> None:
    keys = Keys.load(vehicle.keys_dir, "uav1")
    assert keys.by_curve(keys.curve_public) is not None
    renaming(vehicle, "scout", root)
    assert len([one for one in Root.load(root).roster.valid() if one.curve_public == keys.curve_public]) == 1


IDLE = MissionState(0, "", MissionPhase.IDLE)
FLYING = MissionState(7, "00ab12cd", MissionPhase.RUNNING, mission="formation")


class Member(Removal):
    """A removal of the member uav1, whose checks are called here."""

    def __init__(self, base: Station, root: Path) -> None:
        super().__init__(base, ("uav1",), root, None)
        self._members = ("uav1",)


@pytest.mark.parametrize(
    ("answers", "force", "error"),
    [
        ({"sys/mission/status": MissionStatus("uav1", FLYING, "", 0)}, False, Conflict),
        ({"sys/mission/status": MissionStatus("uav1", FLYING, "", 0)}, True, None),
        ({"sys/mission/status": NoAnswer("silent")}, False, Denied),
        ({"sys/mission/status": NotFound("no service")}, False, None),
    ],
)
async def test_busy_or_silent_node_is_removed_by_force(
    base: Station,
    root: Path,
    monkeypatch: pytest.MonkeyPatch,
    answers: Any,
    force: bool,
    error: type[SwarmError] | None,
) -> None:
    async def disarmed(_: Any) -> bool:
        return False

    monkeypatch.setattr("swarmctl.commands.node.removing.is_armed", disarmed)
    removal, session = Member(base, root), ScriptedSession(answers, node="uav1")
    if error is None:
        await removal._check_idle(session, force=force)
    else:
        with pytest.raises(error, match="uav1"):
            await removal._check_idle(session, force=force)


async def test_an_armed_vehicle_is_not_removed(
    base: Station, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def armed(_: Any) -> bool:
        return True

    monkeypatch.setattr("swarmctl.commands.node.removing.is_armed", armed)
    session = ScriptedSession({"sys/mission/status": MissionStatus("uav1", IDLE, "", 0)}, node="uav1")
    with pytest.raises(Denied, match="armed"):
        await Member(base, root)._check_idle(session, force=False)


async def test_removed_node_leaves_tree_register_and_health() -> None:
    session = ScriptedSession({})
    asked: list[str] = []

    async def request(path: str, value: Any, reply: type[Any], **_: Any) -> Any:
        asked.append(path)
        if "register" in path:
            raise NotFound("no register here")
        return PlatformRemoved(True) if reply is PlatformRemoved else FaultList("gcs", 0)

    session.module.request = request  # type: ignore[method-assign]
    await forget_at(session, "gcs", ["uav1"])
    assert asked == ["/gcs/sys/tree/forget", "/gcs/sys/register/forget", "/gcs/sys/health/clear"]


def test_unused_invitation_is_shown_until_seen_or_revoked(
    base: Station, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def states() -> dict[str, str]:
        printed = len(base.stdout.getvalue())
        list_members(base, root)
        rows = [line.split() for line in base.stdout.getvalue()[printed:].splitlines()[2:]]
        return {row[0]: " ".join(row[3:]) for row in rows}

    invite_nodes(base, root, plan(file=str(tmp_path / "uav1.join"), valid_s=60.0))
    invite_nodes(base, root, plan("uav2", file=str(tmp_path / "uav2.join"), valid_s=60.0))
    assert states() == {"gcs": "member", "uav1": "invited", "uav2": "invited"}
    roster = Root.load(root).roster
    seen = roster.find("uav2")
    assert seen is not None
    RootFolder(root).note_used({("uav2", seen.serial)})
    later = time.time_ns() + 100 * 1_000_000_000
    monkeypatch.setattr("swarmctl.commands.keys.listing.utc_ns", lambda: later)
    assert states() == {"gcs": "member", "uav1": "invitation expired", "uav2": "member"}
    assert "uav1: its file has expired" in base.stderr.getvalue()
    changing.revoke(base, root, ("uav1",), yes=True)
    assert states() == {"gcs": "member", "uav1": "revoked", "uav2": "member"}
