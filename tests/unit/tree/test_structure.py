"""Structures on the wire, and the history of one's own."""

import contextlib
import re
import zlib
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.tree.core.structure import structure
from swarmd.tree.core.structure.index import Index, leaf
from swarmd.tree.core.structure.structure import HISTORY, Changes, History
from swarmware.errors import WireError
from swarmware.model.resource import Resource

A = leaf(Resource(path="a", type="Float"))
B = leaf(Resource(path="b", type="Int", unit="m"))
B_LOST = leaf(Resource(path="b", type="Int", unit="m"), lost=True)
C = leaf(Resource(path="c", type="Text"))


def test_changes_applied_on_other_side_give_same_digest() -> None:
    index = Index([A, B])
    patch = structure.decode(structure.encode([B_LOST, C], ["a"]))
    patch.apply(index)
    assert index.digest == Index([B_LOST, C]).digest


def test_a_template_travels_with_the_changes() -> None:
    patch = structure.decode(structure.encode([C], [], [A, B]))
    assert Index(patch.template).digest == Index([A, B]).digest


def test_dictionary_of_protocol_page_opens_our_structures() -> None:
    page = (Path(__file__).parents[3] / "share/doc/protocol.md").read_text("utf-8")
    (shown,) = re.findall(r"```structure-dictionary\n([0-9a-f]+)\n```", page)
    dictionary = bytes.fromhex(shown)
    plain = zlib.decompressobj(zdict=dictionary).decompress(structure.encode([A, B], ["c"]))
    assert msgspec.msgpack.decode(plain, type=Changes).put == (A.resource, B.resource)
    assert f"dictionary id {zlib.adler32(dictionary):#x}" in " ".join(page.split())


def test_version_changes_with_start_and_with_content() -> None:
    versions = {structure.version(epoch, digest) for epoch in (1, 2) for digest in (0, 1, 1 << 63)}
    assert len(versions) == 6
    assert all(0 <= version < 1 << 32 for version in versions)


@given(st.binary(max_size=200))
def test_any_bytes_are_changes_or_a_wire_error(data: bytes) -> None:
    with contextlib.suppress(WireError):
        structure.decode(data)


@given(
    st.recursive(st.one_of(st.integers(-9, 9), st.text(max_size=5), st.booleans()), st.lists, max_leaves=12)
)
def test_any_packed_data_are_changes_or_wire_error(plain: object) -> None:
    with contextlib.suppress(WireError):
        structure.decode(zlib.compress(msgspec.msgpack.encode(plain)))


def test_descriptor_that_contradicts_itself_is_wire_error() -> None:
    data = zlib.compress(msgspec.msgpack.encode([[{"path": "/uav1/a", "type": "Float"}], [], [], []]))
    with pytest.raises(WireError, match="local path"):
        structure.decode(data)


def test_more_than_frame_may_hold_is_not_inflated() -> None:
    bomb = zlib.compress(msgspec.msgpack.encode(Changes(removed=("x" * 20_000_000,))), 9)
    assert len(bomb) < 100_000
    with pytest.raises(WireError, match="cut short"):
        structure.decode(bomb)


def test_the_history_tells_every_path_changed_since() -> None:
    history = History()
    history.add(1, frozenset({"a"}))
    history.add(2, frozenset({"b"}))
    history.add(3, frozenset({"a", "c"}))
    assert history.since(1) == {"a", "b", "c"}
    assert history.since(3) == {"a", "c"}
    assert history.since(9) is None


def test_structure_returning_differs_from_last_visit() -> None:
    history = History()
    history.add(1, frozenset({"a"}))
    history.add(2, frozenset({"a"}))
    history.add(1, frozenset({"b"}))
    assert history.since(1) == {"b"}
    assert history.since(2) == {"a", "b"}


def test_old_states_are_forgotten() -> None:
    history = History()
    for digest in range(HISTORY + 1):
        history.add(digest, frozenset({f"p{digest}"}))
    assert history.since(0) is None
    assert history.since(1) is not None
