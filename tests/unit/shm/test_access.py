"""Who may join a node: its own user, and members of the group that may read its run directory."""

import fcntl
import os
import shutil
import stat
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import NamedTuple

import msgspec
import pytest

from swarmware.errors import Denied
from swarmware.node.incarnation import NodeIncarnation
from swarmware.transport.appfile.entry import AppEntry, Served, encode
from swarmware.transport.appfile.file import AppFile
from swarmware.transport.appfile.table import AppTable
from swarmware.transport.appfile.trace import last_of
from swarmware.transport.shm.doorbell import Doorbell, DoorbellSenders
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.owner import Owner
from swarmware.transport.shm.reap import remove_all
from swarmware.transport.shm.ring import RingReader, RingWriter

GROUP = 60_000
OWNER, MEMBER, STRANGER = 60_001, 60_002, 60_003

pytestmark = [
    pytest.mark.root,
    pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to become several other users"),
]


@contextmanager
def become(uid: int, gid: int, groups: list[int]) -> Iterator[None]:
    before = os.getgroups()
    os.setgroups(groups)
    os.setegid(gid)
    os.seteuid(uid)
    mask = os.umask(0o027)
    try:
        yield
    finally:
        os.umask(mask)
        os.seteuid(0)
        os.setegid(0)
        os.setgroups(before)


def owner() -> AbstractContextManager[None]:
    return become(OWNER, GROUP, [])


def member() -> AbstractContextManager[None]:
    return become(MEMBER, MEMBER, [GROUP])


class Place(NamedTuple):
    run_dir: Path
    shm_dir: Path
    boot: NodeIncarnation


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Callable[[int], Place]]:
    """A node that its owner runs; the argument is the mode of its run directory."""
    for folder in (tmp_path, *tmp_path.parents):
        if folder.stat().st_uid == 0 and folder != Path("/") and not folder.stat().st_mode & 0o005:
            folder.chmod(0o755)  # pytest keeps its folders to root
    Owner.current()  # what Python loads for it may lie where only root reads
    made: list[Place] = []

    def make(mode: int) -> Place:
        run_dir, shm = tmp_path / "run", tmp_path / "shm"
        for folder in (run_dir, shm):
            folder.mkdir()
            os.chown(folder, OWNER, GROUP)
        run_dir.chmod(mode)
        shm.chmod(0o755)
        with owner():
            found = Place(run_dir, shm / "node", NodeIncarnation(run_dir, shm / "node"))
        made.append(found)
        return found

    yield make
    for one in made:
        with owner():
            one.boot.leave()


def app(place: Place, name: str) -> AppFile:
    return AppFile(place.run_dir, name, endpoint="ipc:///x", started_ns=1)


def test_member_has_application_file_that_all_see(place: Callable[[int], Place]) -> None:
    node = place(0o750)
    with owner():
        tree = app(node, "tree")
    with member():
        guest = NodeIncarnation(node.run_dir, node.shm_dir)
        tool = app(node, "tool")
    try:
        assert guest.guest
        assert not node.boot.guest
        assert guest.boot_id == node.boot.boot_id
        for user in (owner, member):
            with user():
                table = AppTable(node.run_dir)
                table.refresh(probe=True)
                assert {entry.name for entry in table} == {"tree", "tool"}
        found = tool.path.stat()
        assert (found.st_uid, found.st_gid, stat.S_IMODE(found.st_mode)) == (MEMBER, GROUP, 0o640)
    finally:
        with member():
            tool.close()
            guest.leave()
        with owner():
            tree.close()


def write_locked(path: Path, data: bytes) -> int:
    """An application file as any program writes it; its lock is held until the descriptor is closed."""
    fd = os.open(path, os.O_RDWR | os.O_CREAT, 0o640)
    os.fchmod(fd, 0o644)
    fcntl.flock(fd, fcntl.LOCK_EX)
    os.write(fd, data)
    return fd


def claiming(entry: AppEntry, name: str, *addresses: str) -> bytes:
    served = tuple(Served(path=path, type="Goal", kind="request") for path in addresses)
    return encode(
        msgspec.structs.replace(entry, name=name, endpoint="ipc:///evil", started_ns=0, serves=served)
    )


def test_no_file_of_member_serves_what_daemons_serve(place: Callable[[int], Place]) -> None:
    node = place(0o750)
    with owner():
        tree = app(node, "tree")
        served = Served(path="sys/tree/set", type="Goal", kind="request")
        tree.write(msgspec.structs.replace(tree.entry, serves=(served,)))
    apps = node.run_dir / "apps"
    with member():
        paths = ("sys/tree/set", "cmd/abort", "survey/plan")
        fd = write_locked(apps / "zzz#1.toml", claiming(tree.entry, "zzz", *paths))
    for user in (owner, member):
        with user():
            table = AppTable(node.run_dir)
            table.refresh()
            assert table.serving(served.data_id) == tree.entry
            assert table.serving_path("cmd/abort") is None
            planner = table.serving_path("survey/plan")
            assert planner is not None
            assert planner[0].name == "zzz"
            assert table.rejections == (
                "zzz#1 of user 60002 claims sys/tree/set, cmd/abort: served by the user of the node alone",
            )
    os.close(fd)
    with owner():
        tree.close()


def test_no_file_of_member_bears_name_of_daemon(place: Callable[[int], Place]) -> None:
    node = place(0o750)
    with owner():
        tool = app(node, "tool")
    apps = node.run_dir / "apps"
    with member():
        with pytest.raises(Denied, match="application 'broker': a daemon of user 60001"):
            app(node, "broker")
        fds = [
            write_locked(apps / name, claiming(tool.entry, "broker"))
            for name in ("broker#1.toml", "broker#1.dead")
        ]
    with owner():
        table = AppTable(node.run_dir)
        table.refresh()
        assert table.named("broker") is None
        assert len(table.rejections) == 1
        assert "broker is a daemon of the node's user" in table.rejections[0]
        assert last_of(node.run_dir, "broker") is None
        broker = app(node, "broker")
        assert broker.entry.id == "broker#1", "the daemon takes the name that was taken from it"
        table.refresh()
        assert table.named("broker") == broker.entry
        broker.close()
        tool.close()
    for fd in fds:
        os.close(fd)


def test_owner_removes_members_files_at_ring_path(place: Callable[[int], Place]) -> None:
    node = place(0o750)
    ring = node.shm_dir / "nav.pose.ring"
    with member():
        RingWriter(ring, slots=4, slot_bytes=64).write(b"false")
        ring.with_name("nav.pose.ring.new").write_bytes(b"")
    with owner():
        writer = RingWriter(ring, slots=4, slot_bytes=64)
        writer.write(b"true")
        reader = RingReader(ring)
        assert reader.newest() == b"true"
        reader.close()
        writer.close()
    assert ring.stat().st_uid == OWNER


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda path: path.mkdir(mode=0o777), "a folder of user 60003"),
        (lambda path: path.mkdir(mode=0o700), "a folder of user 60003"),
        (lambda path: path.symlink_to("/tmp"), "a symbolic link"),
        (lambda path: path.write_bytes(b""), "a regular file"),
    ],
    ids=["open", "closed", "link", "file"],
)
@pytest.mark.parametrize("name", ["shm/node", "run/apps", "run/p", "run/bells"])
def test_node_refuses_folder_of_foreign_user(
    tmp_path: Path, place: Callable[[int], Place], make: Callable[[Path], None], reason: str, name: str
) -> None:
    node = place(0o750)
    with owner():
        node.boot.leave()
    path = tmp_path / name
    if path.is_dir():
        shutil.rmtree(path)
    path.parent.chmod(0o1777)
    with become(STRANGER, STRANGER, []):
        make(path)
    path.parent.chmod(0o755)
    before = path.lstat()
    with owner(), pytest.raises(Denied) as refused:
        NodeIncarnation(node.run_dir, node.shm_dir)
    assert str(refused.value).startswith(f"{path}: {reason}; expected none, or a folder of user 60001")
    assert path.lstat() == before


def test_node_refuses_folder_writable_by_all(place: Callable[[int], Place]) -> None:
    node = place(0o750)
    with owner():
        node.boot.leave()
        node.shm_dir.mkdir()
        node.shm_dir.chmod(0o777)
        with pytest.raises(Denied, match="a folder that all users may write"):
            NodeIncarnation(node.run_dir, node.shm_dir)


def test_rewritten_file_of_member_is_read_again(place: Callable[[int], Place]) -> None:
    node = place(0o750)
    with owner():
        app(node, "tree").close()
        table = AppTable(node.run_dir)
    with member():
        tool = app(node, "tool")
    try:
        for reads in (("/a/b",), ("/a/c",), ("/a/d",)):
            with member():
                tool.write(msgspec.structs.replace(tool.entry, reads=reads))
            with owner():
                table.refresh()
                assert [entry.reads for entry in table] == [reads]
    finally:
        with member():
            tool.close()


def test_rings_are_readable_by_all_writable_by_owner(
    place: Callable[[int], Place],
) -> None:
    node = place(0o750)
    theirs, ours = node.shm_dir / "theirs.ring", node.shm_dir / "ours.ring"
    with owner():
        daemon = RingWriter(theirs, slots=4, slot_bytes=64)
    with member():
        module = RingWriter(ours, slots=4, slot_bytes=64)
    for path, reader in ((theirs, member), (ours, owner)):
        with reader():
            RingReader(path).close()
            with pytest.raises(PermissionError):
                path.open("r+b")
    with member(), pytest.raises(PermissionError):
        theirs.unlink()
    with owner():
        daemon.close(unlink=True)
    with member():
        module.close()
    with owner():
        remove_all(node.shm_dir, node.run_dir)
    assert not node.shm_dir.exists(), "the end of the node takes what members left"


def test_doorbells_ring_both_ways_whoever_made_the_table(place: Callable[[int], Place]) -> None:
    node = place(0o750)
    bells = node.run_dir / "bells"
    table = node.shm_dir / "some.readers"
    with owner():
        daemon = Doorbell(bells)
    with member():
        tool = Doorbell(bells)
        ReaderNotifier(table, DoorbellSenders(bells)).add(tool.name)  # the member makes the table
    with owner():
        ReaderNotifier(table, DoorbellSenders(bells)).add(daemon.name)
        ReaderNotifier(table, DoorbellSenders(bells)).notify()
    assert daemon.drain()
    assert tool.drain()
    with member():
        ReaderNotifier(table, DoorbellSenders(bells)).notify()
    assert daemon.drain()
    for user, bell in ((owner, daemon), (member, tool)):
        with user():
            bell.close()


def test_unringable_doorbell_stops_no_writer(place: Callable[[int], Place]) -> None:
    node = place(0o750)
    bells = node.run_dir / "bells"
    table = node.shm_dir / "some.readers"
    with owner():
        Doorbell(bells).close()
    with member():
        tool = Doorbell(bells)
        (bells / tool.name).chmod(0)
        ReaderNotifier(table, DoorbellSenders(bells)).add(tool.name)
    with owner():
        ringing = ReaderNotifier(table, DoorbellSenders(bells))
        ringing.notify()
        assert ringing.names() == ()
    with member():
        tool.close()


@pytest.mark.parametrize(("mode", "user"), [(0o700, MEMBER), (0o750, STRANGER)])
def test_whoever_may_not_read_the_folder_is_denied(
    mode: int, user: int, place: Callable[[int], Place]
) -> None:
    node = place(mode)
    groups = [GROUP] if user == MEMBER else []
    with become(user, user, groups), pytest.raises(Denied, match="member"):
        NodeIncarnation(node.run_dir, node.shm_dir)


def test_member_cannot_start_foreign_node(place: Callable[[int], Place]) -> None:
    node = place(0o750)
    with owner():
        node.boot.leave()
    with member(), pytest.raises(Denied, match="this node does not run"):
        NodeIncarnation(node.run_dir, node.shm_dir)


def test_files_of_root_belong_to_node_owner(place: Callable[[int], Place]) -> None:
    node = place(0o700)
    with owner():
        app(node, "tree").close()
    tool = app(node, "tool")
    bell = Doorbell(node.run_dir / "bells")
    assert NodeIncarnation(node.run_dir, node.shm_dir).guest
    assert tool.path.stat().st_uid == OWNER
    with owner():
        assert DoorbellSenders(bell.folder).ring(bell.name)
    bell.close()
    tool.close()
