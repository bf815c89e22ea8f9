"""Application files: locked while the application lives, distinguished by life, never half-read."""

import contextlib
import os
import zlib
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import Conflict, InvalidInput, WireError
from swarmware.model.resource import Resource
from swarmware.transport.appfile import entry
from swarmware.transport.appfile.entry import AppEntry, Served
from swarmware.transport.appfile.file import AppFile
from swarmware.transport.appfile.table import AppTable, populated, scan


def join(run_dir: Path, name: str, instance: int | None = None) -> AppFile:
    return AppFile(run_dir, name, endpoint="ipc:///tmp/x", started_ns=1, instance=instance)


def test_instances_are_numbered_from_one_and_reused(tmp_path: Path) -> None:
    first, second = join(tmp_path, "planner"), join(tmp_path, "planner")
    assert [item.entry.id for item in (first, second)] == ["planner#1", "planner#2"]
    first.close()
    third = join(tmp_path, "planner")
    assert third.entry.id == "planner#1"
    second.close()
    third.close()
    assert list((tmp_path / "apps").iterdir()) == []


def test_a_stated_instance_that_runs_already_is_refused(tmp_path: Path) -> None:
    first = join(tmp_path, "planner", 3)
    with pytest.raises(Conflict, match="planner#3 runs already"):
        join(tmp_path, "planner", 3)
    first.close()
    join(tmp_path, "planner", 3).close()


def test_a_name_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="application name"):
        join(tmp_path, "../x")


def test_the_table_shows_the_living_only(tmp_path: Path) -> None:
    first, second = join(tmp_path, "a"), join(tmp_path, "b")
    table = AppTable(tmp_path)
    changes: list[int] = []
    table.on_change = lambda: changes.append(table.version)
    table.refresh()
    table.refresh()
    assert changes == [1]
    assert [item.id for item in table] == ["a#1", "b#1"]
    os.close(first._fd)  # as the kernel does at the end of a process
    table.refresh(probe=True)
    assert [item.id for item in table] == ["b#1"]
    second.close()
    table.refresh()
    assert scan(tmp_path) == []
    assert changes == [1, 2, 3]


def test_node_is_populated_while_application_holds_its_file(tmp_path: Path) -> None:
    assert not populated(tmp_path)
    app = join(tmp_path, "a")
    (tmp_path / "apps/folder.toml").mkdir()
    assert populated(tmp_path)
    os.close(app._fd)  # as the kernel does at the end of a process: its file remains
    assert scan(tmp_path) == []
    assert not populated(tmp_path)


def test_a_file_rewritten_in_place_is_seen(tmp_path: Path) -> None:
    told: list[int] = []
    app = AppFile(tmp_path, "a", endpoint="e", started_ns=1, announce=lambda: told.append(1))
    table = AppTable(tmp_path)
    table.refresh()
    served = Served(path="cmd/goto", type="Goal", kind="message")
    app.write(
        AppEntry(
            name="a",
            instance=1,
            pid=app.entry.pid,
            pid_start=app.entry.pid_start,
            endpoint="e",
            started_ns=1,
            serves=(served,),
            provides=(Resource(path="nav/pose", type="Pose", rate_hz=20.0, range=(0.0, 1.0)),),
            reads=("/*/nav/pose",),
            config={"speed": 1.5, "nested": {"none": None, "list": [1, 2]}},
        )
    )
    assert len(told) == 2
    table.refresh()
    assert table.version == 2
    found = table.serving(served.data_id)
    assert found is not None
    assert found.provides[0].rate_hz == 20.0
    assert found.config == {"speed": 1.5, "nested": {"list": [1, 2]}}
    assert table.serving_path("cmd/goto") == (found, served)
    assert table.application(found.app_id) is found
    app.close()


def described(run_dir: Path, path: str) -> AppEntry:
    """An application that runs, with a served path, a resource and a configuration."""
    app = join(run_dir, "planner")
    app.write(
        msgspec.structs.replace(
            app.entry,
            serves=(Served(path=path, type="Goal", kind="message"),),
            provides=(Resource(path="nav/pose", type="Pose", range=(0.0, float("inf"))),),
            reads=("/*/nav/pose",),
            config={"nested": {"speed": 1.5}},
        )
    )
    return app.entry


def test_message_table_is_sufficient_and_completed_on_demand(tmp_path: Path) -> None:
    written = described(tmp_path, "cmd/goto")
    table = AppTable(tmp_path, whole=False)
    table.refresh()
    assert list(table) == [msgspec.structs.replace(written, provides=(), config={})]
    table.complete()
    table.refresh()
    assert list(table) == [written]
    version = table.version
    table.complete()
    table.refresh()
    assert table.version == version, "it was complete"


def test_message_table_reads_whole_file_of_served_tables(tmp_path: Path) -> None:
    written = described(tmp_path, "cmd/" + "a" * 100)
    assert b"[[serves]]" in (tmp_path / "apps/planner#1.toml").read_bytes()
    table = AppTable(tmp_path, whole=False)
    table.refresh()
    assert list(table) == [written]


@pytest.mark.parametrize("value", ['"""\n[[a]]\n"""', "[\n[1], # ]\n[2]]", "'''\n[b]'''"])
def test_line_of_value_is_not_taken_for_table(value: str) -> None:
    whole = AppEntry(name="a", instance=1, pid=2, pid_start=3, endpoint="ipc://x", started_ns=4)
    text = f"more = {value}\n{entry.encode(whole).decode().rpartition('# crc32')[0]}"
    data = f"{text}# crc32 {zlib.crc32(text.encode()):08x}\n".encode()
    assert entry.decode(data, "x", whole=False) == entry.decode(data, "x") == whole


def test_file_that_is_being_written_is_read_later(tmp_path: Path) -> None:
    app = join(tmp_path, "a")
    table = AppTable(tmp_path)
    table.refresh()
    whole = app.path.read_bytes()
    app.path.write_bytes(whole[:-20])
    table.refresh(probe=True)
    assert [item.id for item in table] == ["a#1"]
    app.path.write_bytes(whole)
    table.refresh()
    assert [item.id for item in table] == ["a#1"]
    app.close()


@given(st.binary(max_size=400))
def test_any_bytes_are_entry_or_wire_error(data: bytes) -> None:
    with pytest.raises(WireError):
        entry.decode(data, "x")


@given(st.integers(0, 200), st.integers(0, 255))
def test_a_changed_byte_is_found(at: int, value: int) -> None:
    whole = AppEntry(name="a", instance=1, pid=2, pid_start=3, endpoint="ipc://x", started_ns=4)
    data = bytearray(entry.encode(whole))
    at %= len(data)
    if data[at] == value or at == len(data) - 1:
        return
    data[at] = value
    with contextlib.suppress(WireError):
        assert entry.decode(bytes(data), "x") == whole  # the case of a digit of the checksum
