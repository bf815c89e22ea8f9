"""`swarmctl keys` with files and sockets of this computer: each step, each error, and what a kill leaves."""

import json
import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.unit.cli.invitation import WAIT_S, Station, inviting_at, plan

from swarmctl.commands.keys.listing import list_members, show_member
from swarmctl.commands.keys.making import make_root
from swarmctl.membership import changing, node_keys
from swarmctl.membership.inviting import invite_nodes
from swarmctl.membership.joining import join
from swarmctl.membership.root_folder import RootFolder
from swarmware.errors import (
    ConfigError,
    Conflict,
    Denied,
    InvalidInput,
    NoAnswer,
    NotFound,
    Partial,
    SwarmError,
)
from swarmware.runtime.filewriter import replace_file
from swarmware.testing.tmpnode import make_node
from swarmware.transport.enrolment.token import JoinToken
from swarmware.transport.security.root import Root


@pytest.fixture
def base(tmp_path: Path) -> Station:
    """A ground station, whose computer has the root in `root`."""
    station = Station(make_node(tmp_path, "gcs"))
    make_root(station, tmp_path / "root", "harbour")
    return station


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return tmp_path / "root"


@pytest.fixture(autouse=True)
def no_usual_root(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "home"))


@pytest.fixture
def vehicle(tmp_path: Path) -> Station:
    return Station(make_node(tmp_path, "uav1"))


def test_two_nodes_become_members_of_one_swarm(base: Station, vehicle: Station, root: Path) -> None:
    with inviting_at(base, root, plan()) as token:
        join(vehicle, token("uav1"), None, replace=False)
    assert "uav1 joined from 127.0.0.1" in base.stderr.getvalue()
    mine, theirs = base.keys("gcs"), vehicle.keys("uav1")
    assert mine.signed == theirs.signed, "the node of the inviter has the new roster, too"
    assert mine.group.key == theirs.group.key
    assert mine.roster is not None and mine.roster.swarm == "harbour"
    assert {name: role.name for name, role in mine.roster.roles().items()} == {
        "gcs": "MAINTAINER",
        "uav1": "NODE",
    }
    modes = {path.name: path.stat().st_mode & 0o777 for path in vehicle.keys_dir.iterdir()}
    assert modes == {"node.key": 0o600, "root.pub": 0o644, "roster.json": 0o644}
    assert vehicle.keys_dir.stat().st_mode & 0o077 == 0
    assert root.stat().st_mode & 0o077 == 0 and (root / "root.key").stat().st_mode & 0o077 == 0
    assert "start uav1" in vehicle.stderr.getvalue()


def test_several_platforms_join_with_token_each_and_role(
    base: Station, vehicle: Station, root: Path, tmp_path: Path
) -> None:
    other = Station(make_node(tmp_path, "uav2"), output="json")
    with inviting_at(base, root, plan("uav1", "uav2", role="operator")) as token:
        join(other, token("uav2"), None, replace=False)
        with pytest.raises(InvalidInput, match="the invitation is for uav2; `platform`"):
            join(vehicle, token("uav2"), None, replace=False)
        join(vehicle, token("uav1"), None, replace=False)
    assert json.loads(other.stdout.getvalue())["role"] == "operator"
    assert [entry["used"] for entry in json.loads((root / "invitations.json").read_text())] == [True, True]


def test_used_expired_or_ended_token_is_refused(
    base: Station, vehicle: Station, root: Path, tmp_path: Path
) -> None:
    wanted = plan("uav1", "uav2")
    thief, late = Station(make_node(tmp_path / "thief", "uav1")), Station(make_node(tmp_path, "uav2"))
    with inviting_at(base, root, wanted) as token:
        used = token("uav1")
        join(vehicle, used, None, replace=False)
        with pytest.raises(Denied, match="the token was used: another node has joined as uav1"):
            join(thief, used, None, replace=False)
        join(late, token("uav2"), None, replace=False)
    short = plan("uav2", valid_s=0.2, address=wanted.address)
    with pytest.raises(NoAnswer, match=r"uav2: did not join within 0.2s"):
        invite_nodes(base, root, short)
    expired = base.stdout.getvalue().split()[-1]
    with pytest.raises(NoAnswer, match=r"127.0.0.1: Connection refused; expected `swarmctl keys invite`"):
        join(late, expired, None, replace=True)
    with inviting_at(base, root, plan("uav1", address=wanted.address)) as token:
        text = token("uav1")
        for former, reason in ((used, "token was used"), (expired, "token has expired|has ended")):
            named = thief if former is used else late
            with pytest.raises(Denied, match=reason):
                join(named, former, None, replace=True)
        join(thief, text, None, replace=False)
    roster = base.keys("gcs").roster
    assert roster is not None
    assert vehicle.keys("uav1").curve_public != thief.keys("uav1").curve_public
    found = roster.find("uav1")
    assert found is not None
    assert found.curve_public == thief.keys("uav1").curve_public, "the former one is revoked"


def test_some_that_do_not_come_make_result_partial(base: Station, vehicle: Station, root: Path) -> None:
    with (
        pytest.raises(Partial, match="uav2: did not join"),
        inviting_at(base, root, plan("uav1", "uav2", valid_s=3.0)) as token,
    ):
        join(vehicle, token("uav1"), None, replace=False)


def test_a_mistyped_token_is_noticed_before_anything_happens(vehicle: Station) -> None:
    with pytest.raises(InvalidInput, match="mistyped"):
        join(vehicle, JoinToken(bytes(16), bytes(16), 0).text()[:-1] + "z", None, replace=False)
    assert not vehicle.keys_dir.exists()


def test_clock_that_differs_from_inviters_is_warning(
    base: Station, vehicle: Station, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    late = time.time_ns() - 3600 * 1_000_000_000
    monkeypatch.setattr("swarmctl.membership.joining.utc_ns", lambda: late)
    with inviting_at(base, root, plan()) as token:
        join(vehicle, token("uav1"), None, replace=False)
    assert "behind the inviter" in vehicle.stderr.getvalue()
    assert vehicle.keys("uav1").roster is not None, "and no reason to refuse the node"


def test_existing_identity_is_kept_unless_replaced(base: Station, vehicle: Station, root: Path) -> None:
    with inviting_at(base, root, plan()) as token:
        join(vehicle, token("uav1"), None, replace=False)
    before = (vehicle.keys_dir / "node.key").read_bytes()
    with inviting_at(base, root, plan()) as token:
        with pytest.raises(Conflict, match=r"uav1 has the keys of a swarm.*--replace"):
            join(vehicle, token("uav1"), None, replace=False)
        assert (vehicle.keys_dir / "node.key").read_bytes() == before
        join(vehicle, token("uav1"), None, replace=True)
    assert (vehicle.keys_dir / "node.key").read_bytes() != before
    assert base.keys("gcs").signed == vehicle.keys("uav1").signed


def test_node_that_runs_is_not_given_another_identity(base: Station, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(node_keys.NodeKeys, "runs", True)
    with pytest.raises(Conflict, match="gcs runs with the keys that would be replaced"):
        join(base, JoinToken(bytes(16), bytes(16), 0, ("127.0.0.1",)).text(), None, replace=True)


def test_init_refuses_to_overwrite_and_names_remedy(
    base: Station, vehicle: Station, root: Path, tmp_path: Path
) -> None:
    before = {path: path.read_bytes() for path in (*root.iterdir(), *base.keys_dir.iterdir())}
    with pytest.raises(Conflict, match="gcs has the keys of a swarm"):
        make_root(base, tmp_path / "other", "x")
    with pytest.raises(Conflict, match="members gcs; expected `swarmctl keys invite uav1` to add it"):
        make_root(vehicle, root, "x")
    assert before == {path: path.read_bytes() for path in before}
    assert not vehicle.keys_dir.exists() and not (tmp_path / "other" / "root.key").exists()


@pytest.mark.parametrize("files", [(), ("node.key",), ("node.key", "roster.json"), ("node.key", "root.pub")])
def test_init_that_was_killed_is_completed_by_next(base: Station, root: Path, files: tuple[str, ...]) -> None:
    for name in ("node.key", *files):
        (base.keys_dir / name).unlink(missing_ok=True)
    make_root(base, root, "harbour")
    assert base.keys("gcs").root_public == Root.load(root).public


def test_join_with_lost_answer_repeats_same_key(
    base: Station, vehicle: Station, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after a kill between the request and the files."""
    other = Station(make_node(tmp_path, "uav2"))
    with inviting_at(base, root, plan("uav1", "uav2")) as token:
        with monkeypatch.context() as patch:
            patch.setattr(node_keys, "write_keys", _killed)
            with pytest.raises(KeyboardInterrupt):
                join(vehicle, token("uav1"), None, replace=False)
        assert {path.name for path in vehicle.keys_dir.iterdir()} == {"join.key"}
        version = Root.load(root).roster.version
        join(vehicle, token("uav1"), None, replace=False)
        assert Root.load(root).roster.version == version, "the same admission, not another one"
        assert vehicle.keys("uav1").signed == base.keys("gcs").signed
        assert not (vehicle.keys_dir / "join.key").exists()
        join(other, token("uav2"), None, replace=False)


def _killed(*_: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize("count", range(4))
def test_kill_between_files_leaves_no_half_identity(
    base: Station, vehicle: Station, root: Path, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    written: list[str] = []

    def killed_after(path: Path, data: bytes, **options: Any) -> None:
        if threading.current_thread() is threading.main_thread():
            if len(written) == count:
                raise KeyboardInterrupt
            written.append(path.name)
        replace_file(path, data, **options)

    with inviting_at(base, root, plan()) as token:
        text = token("uav1")
        with monkeypatch.context() as patch:
            patch.setattr("swarmware.transport.security.keys.replace_file", killed_after)
            with pytest.raises(KeyboardInterrupt) if count < 3 else _nothing():
                join(vehicle, text, None, replace=False)
        if count < 3:
            assert not (vehicle.keys_dir / "node.key").exists(), "a node without keys, as before"
            join(vehicle, text, None, replace=False)  # the same line: the inviter waits until it has its keys
    assert vehicle.keys("uav1").signed == base.keys("gcs").signed


@contextmanager
def _nothing() -> Iterator[None]:
    yield


def test_lost_root_is_named_with_option(base: Station, root: Path) -> None:
    (root / "root.key").rename(root.parent / "kept")
    commands: tuple[Callable[[], None], ...] = (
        lambda: invite_nodes(base, root, plan()),
        lambda: changing.rotate(base, root),
        lambda: changing.revoke(base, root, ("gcs",), yes=True),
    )
    for command in commands:
        with pytest.raises(NotFound, match=r"root key is not in it.*--root DIR"):
            command()


def test_older_root_copy_continues_from_nodes_roster(
    base: Station, vehicle: Station, root: Path, tmp_path: Path
) -> None:
    shutil.copytree(root, tmp_path / "copy")
    with inviting_at(base, root, plan()) as token:
        join(vehicle, token("uav1"), None, replace=False)
    changing.revoke(base, root, ("uav1",), yes=True)
    changing.rotate(base, tmp_path / "copy")
    assert "is an older copy of the root" in base.stderr.getvalue().replace("\n", " ")
    roster = base.keys("gcs").roster
    assert roster is not None and roster.version == Root.load(root).roster.version + 1
    assert roster.find("uav1") is None, "the copy has not brought back a revoked member"
    assert roster.key_epoch == Root.load(root).roster.key_epoch + 1


def test_a_root_of_another_swarm_is_refused(base: Station, vehicle: Station, tmp_path: Path) -> None:
    make_root(vehicle, tmp_path / "other", "x")
    commands: tuple[Callable[[], None], ...] = (
        lambda: invite_nodes(base, tmp_path / "other", plan("uav2")),
        lambda: changing.rotate(base, tmp_path / "other"),
    )
    for command in commands:
        with pytest.raises(Denied, match="gcs belongs to the swarm of root"):
            command()


def test_a_root_that_others_can_read_is_refused(base: Station, root: Path) -> None:
    (root / "root.key").chmod(0o644)
    with pytest.raises(Denied, match="other users can read it"):
        changing.rotate(base, root)


def test_stick_that_was_removed_leaves_token_valid(base: Station, vehicle: Station, root: Path) -> None:
    with inviting_at(base, root, plan()) as token:
        text = token("uav1")
        (root / "root.key").rename(root / "away")
        with pytest.raises(SwarmError, match=r"could not sign the roster: .*root key is not in it"):
            join(vehicle, text, None, replace=False)
        (root / "away").rename(root / "root.key")
        join(vehicle, text, None, replace=False)


def test_missing_node_on_computer_names_places(tmp_path: Path) -> None:
    nowhere = Station(tmp_path / "none")
    commands: tuple[Callable[[], None], ...] = (
        lambda: make_root(nowhere, tmp_path / "root", "x"),
        lambda: join(nowhere, JoinToken(bytes(16), bytes(16), 0, ("10.0.0.1",)).text(), None, replace=False),
    )
    for command in commands:
        with pytest.raises(ConfigError, match=r"node.toml: no such file"):
            command()
    assert not (tmp_path / "root").exists()


def test_inaccessible_folder_is_named(
    tmp_path: Path, base: Station, vehicle: Station, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.access", lambda path, mode: False)  # root may do everything
    with pytest.raises(Denied, match="keys: not readable by this user"):
        make_root(base, tmp_path / "other", "x")
    with pytest.raises(Denied, match="not writable by this user"):
        make_root(vehicle, tmp_path / "other", "x")
    assert not (tmp_path / "other").exists()


def test_credentials_by_file_need_no_network_and_token(
    base: Station, vehicle: Station, root: Path, tmp_path: Path
) -> None:
    file = tmp_path / "uav1.join"
    invite_nodes(base, root, plan(file=str(file)))
    command = base.stdout.getvalue().splitlines()[-1].split()
    assert command[2] == "join" and command[4:] == ["--file", str(file)]
    assert file.stat().st_mode & 0o777 == 0o600
    with pytest.raises(InvalidInput, match="expected --file"):
        join(vehicle, command[3], None, replace=False)
    join(vehicle, command[3], file, replace=False)
    assert vehicle.keys("uav1").signed == base.keys("gcs").signed


def test_file_expires_by_clock_of_node(
    base: Station, vehicle: Station, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "uav1.join"
    invite_nodes(base, root, plan(file=str(file), valid_s=60.0))
    text = base.stdout.getvalue().split()[-3]
    later = time.time_ns() + 100 * 1_000_000_000
    monkeypatch.setattr("swarmctl.membership.joining.utc_ns", lambda: later)
    with pytest.raises(Denied, match="by this computer's clock"):
        join(vehicle, text, file, replace=False)
    assert not (vehicle.keys_dir / "node.key").exists()


GARBAGE = (
    b"",
    b"\0",
    b"GET / HTTP/1.1\r\n\r\n",
    b"\xff" * 5000,
    b"\0\0\0\x04SWJ1",
    b"\0\0\4\0" + bytes(1024),
)


def received(sender: socket.socket) -> bytes:
    """What the inviter sends; nothing when it closes the connection with bytes unread."""
    try:
        return sender.recv(64)
    except ConnectionResetError:
        return b""


def test_garbage_and_floods_do_not_end_the_inviter(base: Station, vehicle: Station, root: Path) -> None:
    wanted = plan()
    port = int(wanted.address.rpartition(":")[2])
    with inviting_at(base, root, wanted) as token:
        text = token("uav1")
        for data in GARBAGE:
            with closing(socket.create_connection(("127.0.0.1", port), WAIT_S)) as sender:
                sender.sendall(data)
                sender.shutdown(socket.SHUT_WR)
                assert received(sender) == b""
        join(vehicle, text, None, replace=False)
    assert vehicle.keys("uav1").roster is not None


def test_revoked_member_leaves_roster_and_changes_key(base: Station, vehicle: Station, root: Path) -> None:
    with inviting_at(base, root, plan()) as token:
        join(vehicle, token("uav1"), None, replace=False)
    before = base.keys("gcs")
    with pytest.raises(NotFound, match="uav7 is not a member"):
        changing.revoke(base, root, ("uav7",), yes=True)
    with pytest.raises(InvalidInput, match="gcs: the node on this computer"):
        changing.revoke(base, root, ("gcs",), yes=True)
    changing.revoke(base, root, ("uav1",), yes=True)
    after = base.keys("gcs")
    assert after.roster is not None and after.roster.find("uav1") is None
    assert after.group.epoch == before.group.epoch + 1 and after.group.key != before.group.key
    list_members(base, None)
    assert "revoked" in base.stdout.getvalue()


def test_rotation_changes_group_key_and_nothing_else(base: Station, root: Path) -> None:
    before = base.keys("gcs")
    changing.rotate(base, root)
    after = base.keys("gcs")
    assert after.group.epoch == before.group.epoch + 1
    assert after.former == (before.group,)
    assert before.roster is not None and after.roster is not None
    assert [m.serial for m in after.roster.valid()] == [m.serial for m in before.roster.valid()]


def test_members_are_listed_and_shown_as_documents(base: Station, root: Path, vehicle: Station) -> None:
    listed = Station(base.keys_dir.parent / "etc", output="json")
    list_members(listed, None)
    document = json.loads(listed.stdout.getvalue())
    assert [(one["platform"], one["role"]) for one in document["members"]] == [("gcs", "maintainer")]
    assert document["source"] == str(base.keys_dir)
    show_member(base, root, "gcs")
    assert document["fingerprint"] in base.stdout.getvalue()
    with pytest.raises(NotFound, match="uav3: not a member of swarm 'harbour'; expected one of gcs"):
        show_member(base, None, "uav3")
    with pytest.raises(NotFound, match="expected `swarmctl keys init`"):
        list_members(vehicle, None)


def test_a_damaged_record_of_invitations_names_its_place(base: Station, root: Path) -> None:
    for damage in (b"{", b'[{"number": "xy", "platform": "a", "role": "node", "expires_utc_s": 1}]'):
        (root / "invitations.json").write_bytes(damage)
        with pytest.raises(ConfigError, match=r"invitations.json"):
            RootFolder(root).refused(0)
