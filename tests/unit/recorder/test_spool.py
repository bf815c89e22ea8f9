"""Streams of untyped MessagePack: ours come back as they were, others' are shown, garbage is named."""

import io

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import WireError
from swarmware.recorder.entry import LogEntry
from swarmware.recorder.query import Query
from swarmware.recorder.spool import SpoolSource, write
from swarmware.types import registry
from swarmware.types.scalar import Int

ENTRIES = [
    LogEntry("uav1:nav:out", n, "uav1", "nav/count", "board", "Int", -n, 1000 + n, registry.encode(Int(n)))
    for n in range(1, 6)
]


def spool(data: bytes) -> SpoolSource:
    return SpoolSource(io.BytesIO(data), "a.spool")


def test_entries_come_back_as_they_were() -> None:
    file = io.BytesIO()
    assert write(ENTRIES, file) == 5
    assert list(spool(file.getvalue()).entries(Query())) == ENTRIES
    assert list(spool(file.getvalue()).entries(Query(limit=2, newest=True))) == ENTRIES[-2:]
    assert list(spool(file.getvalue()).entries(Query(pattern="/ugv*/**"))) == []


def test_values_of_another_system_keep_their_order() -> None:
    values = [{"t": 1, 2: b"x"}, [1, 2.5, None], "text", dict.fromkeys(LogEntry.__struct_fields__, "wrong")]
    found = list(spool(b"".join(msgpack.packb(v) for v in values)).entries(Query()))
    assert [entry.topic for entry in found] == ["/foreign/spool"] * 4
    assert [entry.sequence for entry in found] == [1, 2, 3, 4]
    assert found[1].plain() == [1, 2.5, None]


def test_stream_that_is_cut_gives_what_was_whole() -> None:
    file = io.BytesIO()
    write(ENTRIES, file)
    assert list(spool(file.getvalue()[:-3]).entries(Query())) == ENTRIES[:-1]


def test_garbage_is_named_by_its_byte() -> None:
    with pytest.raises(WireError, match=r"a\.spool: byte \d+: invalid MessagePack"):
        list(spool(msgpack.packb(1) + b"\xc1").entries(Query()))


@given(st.binary(max_size=200))
def test_any_bytes_are_entries_or_a_wire_error(data: bytes) -> None:
    try:
        found = list(spool(data).entries(Query()))
    except WireError:
        return
    assert all(isinstance(entry, LogEntry) for entry in found)
