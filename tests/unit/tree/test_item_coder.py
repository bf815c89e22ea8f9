"""The coder of notifications: once for all subscribers, measured, damaged input."""

import asyncio
import random
from pathlib import Path

import msgspec

from swarmd.tree.core.action import Coding, SendNotify
from swarmd.tree.exchange.boundary import Boundary
from swarmd.tree.exchange.item_coder import BESIDE_BYTES, ItemCoder
from swarmware.model.compression import CONTAINER, READABLE, Compression
from swarmware.model.frame import FrameKind
from swarmware.module.jpeg import to_pixels
from swarmware.types import registry
from swarmware.types.perception import Image, ImageEncoding
from swarmware.types.scalar import Blob
from swarmware.types.tree_exchange import TreeItem, TreeNotify

RECORDING = (Path(__file__).parents[3] / "share/swarm/data/vlp16/recording.bin").read_bytes()
ALL = frozenset(READABLE)


class Rig:
    """A coder and what it refuses."""

    def __init__(self) -> None:
        self.boundary = Boundary()
        self.coder = ItemCoder(self.boundary)

    def send(
        self, *items: TreeItem, method: str = "zstd:1", reads: frozenset[str] = ALL, platform: str = "gcs"
    ) -> TreeNotify:
        coding = Coding("Blob", Compression.parse(method), reads)
        action = SendNotify(platform, TreeNotify("uav1", 1, 5, items), {"sensor/lidar": coding})
        return asyncio.run(self.coder.coded(action))


def packet(sequence: int, data: bytes | None = None, path: str = "sensor/lidar") -> TreeItem:
    at = sequence % 900 * 1206
    value = registry.encode(Blob(RECORDING[at : at + 1206] if data is None else data))
    return TreeItem(path, 9, FrameKind.STREAM, sequence, sequence, value)


def test_only_coded_resources_are_compressed_in_order() -> None:
    rig = Rig()
    items = [packet(1), packet(2), packet(3, path="sensor/other"), packet(4)]
    sent = rig.send(*items)
    assert [(item.path, item.codec) for item in sent.items] == [
        ("sensor/lidar", CONTAINER),
        ("sensor/other", 0),
        ("sensor/lidar", CONTAINER),
    ]
    assert sent.serial == 5
    assert rig.coder.plain(sent).items == tuple(items)
    assert rig.boundary.refused == 0


def test_a_notification_without_codings_is_the_same_object() -> None:
    rig = Rig()
    notify = TreeNotify("uav1", 1, 5, (packet(1),))
    assert asyncio.run(rig.coder.coded(SendNotify("gcs", notify))) is notify
    assert rig.coder.plain(notify) is notify


def test_items_are_compressed_once_for_all_subscribers() -> None:
    rig = Rig()
    first = rig.send(packet(1), packet(2))
    [state] = rig.coder.states()
    second = rig.send(packet(1), packet(2), platform="uav2")
    assert first.items == second.items
    assert rig.coder.states() == (state,)
    assert state.coded_bytes < 0.6 * state.plain_bytes
    other = rig.send(packet(1), packet(2), reads=frozenset({"zlib"}))
    assert [item.codec for item in other.items] == [0, 0], "it does not read zstd"


def test_large_values_are_compressed_beside_the_loop() -> None:
    rig = Rig()
    large = packet(1, bytes(BESIDE_BYTES + 1))
    sent = rig.send(large)
    assert len(sent.items[0].data) < 1000
    assert rig.coder.plain(sent).items == (large,)


def test_incompressible_values_are_sent_plain() -> None:
    rig = Rig()
    noise = packet(1, random.Random(1).randbytes(1200))
    assert rig.send(noise).items == (noise,)
    [state] = rig.coder.states()
    assert state.coded_bytes == state.plain_bytes > 0


def test_images_become_jpeg_for_any_receiver() -> None:
    rig = Rig()
    image = Image(64, 48, ImageEncoding.MONO8, bytes((x + y) % 256 for y in range(48) for x in range(64)))
    item = msgspec.structs.replace(packet(1), data=registry.encode(image))
    [coded] = rig.send(item, method="jpeg:80", reads=frozenset()).items
    assert coded.codec == 0
    assert len(coded.data) < len(item.data) / 2
    assert to_pixels(registry.decode(Image, coded.data)).width == 64
    assert rig.coder.states()[0].refused == ""


def test_non_images_are_sent_without_jpeg() -> None:
    rig = Rig()
    sent = rig.send(packet(1), method="jpeg:80")
    assert sent.items == (packet(1),)
    [state] = rig.coder.states()
    assert "Image" in state.refused


def test_damaged_items_are_counted_and_others_arrive() -> None:
    rig = Rig()
    sent = rig.send(packet(1), packet(2))
    broken = msgspec.structs.replace(sent.items[0], data=sent.items[0].data[:-3])
    received = rig.coder.plain(msgspec.structs.replace(sent, items=(packet(7), broken, *sent.items)))
    assert received.items == (packet(7), packet(1), packet(2))
    assert rig.boundary.refused == 1
    assert "uav1" in next(iter(rig.boundary.counts))
