"""Compressed items of notifications: runs of one resource, receivers that cannot read them, damaged ones."""

from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.tree.core.action import Coding
from swarmd.tree.core.notification.item_coding import (
    SMALLEST,
    code,
    decode,
    is_worth,
    runs,
)
from swarmware.errors import WireError
from swarmware.model.compression import CONTAINER, READABLE, Compression, pack
from swarmware.model.frame import FrameKind
from swarmware.types import registry
from swarmware.types.scalar import Blob
from swarmware.types.tree_exchange import TreeItem

RECORDING = (Path(__file__).parents[3] / "share/swarm/data/vlp16/recording.bin").read_bytes()
ALL = frozenset(READABLE)


def coding(method: str = "zstd:1", type_: str = "Blob", reads: frozenset[str] = ALL) -> Coding:
    return Coding(type_, Compression.parse(method), reads)


def packets(count: int, first: int = 0) -> list[TreeItem]:
    return [
        TreeItem(
            "sensor/lidar",
            9,
            FrameKind.STREAM,
            100 + index,
            index * 1_328_000,
            registry.encode(Blob(RECORDING[index * 1206 : (index + 1) * 1206])),
        )
        for index in range(first, first + count)
    ]


def size(items: list[TreeItem]) -> int:
    return sum(len(item.data) for item in items)


def plain(items: list[TreeItem]) -> list[TreeItem]:
    found = list(decode(items))
    assert not any(isinstance(item, WireError) for item in found)
    return [item for item in found if isinstance(item, TreeItem)]


@pytest.mark.parametrize("method", ["zlib:1", "zlib:6", "zstd:1"])
def test_lidar_packets_together_shrink_below_third(method: str) -> None:
    items = packets(26)
    coded = code(items, coding(method))
    assert [item.codec for item in coded] == [CONTAINER]
    assert size(coded) < 0.35 * size(items)
    assert plain(coded) == items


def test_receiver_without_columns_gets_none() -> None:
    items = packets(26)
    coded = code(items, coding(reads=frozenset({"zstd", "zlib"})))
    assert 0.4 * size(items) < size(coded) < 0.7 * size(items)
    assert plain(coded) == items


def test_receiver_without_method_gets_plain_values() -> None:
    assert is_worth(packets(1), coding("zlib:1"))
    assert not is_worth(packets(1), coding("zstd:1", reads=frozenset({"zlib"})))
    assert not is_worth(packets(1), coding("zlib:1", reads=frozenset()))
    assert not is_worth(packets(1), coding("none"))
    assert is_worth(packets(1), coding("jpeg:80", "Image", frozenset())), (
        "an image says itself that it is one"
    )


def test_small_values_are_not_worth_it() -> None:
    item = msgspec.structs.replace(packets(1)[0], data=bytes(SMALLEST - 1))
    assert not is_worth([item], coding())
    assert is_worth([item, item], coding())


def test_incompressible_values_stay_unchanged() -> None:
    noise = msgspec.structs.replace(packets(1)[0], data=bytes((i * i * 7 + i // 3) % 251 for i in range(600)))
    noise = msgspec.structs.replace(noise, data=pack(noise.data, Compression.parse("zstd:19")))
    assert code([noise], coding()) == [noise]


ITEMS = st.lists(
    st.builds(
        TreeItem,
        path=st.just("a/b"),
        data_id=st.just(7),
        kind=st.sampled_from([FrameKind.STREAM, FrameKind.EVENT]).map(int),
        sequence=st.integers(0, 2**40),
        stamp_ns=st.integers(-(2**62), 2**62),
        data=st.one_of(st.binary(max_size=600), st.just(bytes(1000))),
        codec=st.sampled_from([0, 1, 7]),
    ),
    min_size=1,
    max_size=6,
)


@given(ITEMS, st.sampled_from(["Blob", "PointCloud", "Unknown"]), st.sampled_from(["zlib:1", "zstd:1"]))
def test_any_run_comes_back_as_it_was(items: list[TreeItem], type_: str, method: str) -> None:
    assert plain(code(items, coding(method, type_))) == items


@given(st.binary(max_size=200))
def test_damaged_container_is_error_with_path(data: bytes) -> None:
    good = packets(2)
    broken = msgspec.structs.replace(good[0], data=data, codec=CONTAINER)
    found = list(decode([good[0], broken, *code(packets(8), coding())]))
    assert found[0] == good[0]
    assert isinstance(found[1], WireError)
    assert "sensor/lidar" in str(found[1])
    assert found[2:] == packets(8)


@pytest.mark.parametrize(
    "run",
    [
        [[[12, 1, 0, 0, 5]], b"four"],
        [[[12, 1, 0, 0, 2**62]], b"four"],
        [[[12, 1, 0, 0, 2], [12, 2, 0, 0, 3]], b"four"],
        [[], b"four"],
        ["text", b""],
        [[[12, -1, 0, 0, 4]], b"four"],
    ],
)
def test_a_run_whose_sizes_differ_is_an_error(run: object) -> None:
    data = pack(msgspec.msgpack.encode(run), Compression.parse("zlib"))
    item = msgspec.structs.replace(packets(1)[0], data=data, codec=CONTAINER)
    [found] = decode([item])
    assert isinstance(found, WireError)


def test_runs_are_of_one_resource_each() -> None:
    a, b = packets(2), [msgspec.structs.replace(item, path="x/y") for item in packets(1)]
    assert [(path, len(run)) for path, run in runs([*a, *b, *a])] == [
        ("sensor/lidar", 2),
        ("x/y", 1),
        ("sensor/lidar", 2),
    ]
