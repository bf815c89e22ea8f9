"""share/doc/protocol.md, sections 8 to 18: what is made by the page is what the library takes, and back."""

import asyncio
import fcntl
import os
import re
import struct
import zlib
from hashlib import blake2b
from pathlib import Path

import msgspec
import pytest

from swarmd.health.config import Config as HealthConfig
from swarmd.mission.config import Config as MissionConfig
from swarmd.mission.core.announcement import INTERVAL_NS
from swarmd.mission.core.barrier import ANNOUNCED, LATE_NS, PATIENCE
from swarmd.timesync.core.exchange import ASK_FIRST_NS, ASK_NS
from swarmd.tree.config import Config as TreeConfig
from swarmd.tree.core.notification.lane import (
    LANE,
)
from swarmd.tree.core.notification.reorder_buffer import REORDER_WINDOW
from swarmd.tree.core.structure import structure
from swarmd.tree.core.structure.index import Index, leaf
from swarmd.tree.core.structure.subscription import make_subscription
from swarmd.tree.core.subscribers.subscriber import BYTES_LIMIT, ITEMS_LIMIT
from swarmware.errors import KINDS, WireError
from swarmware.mission.model import content_hash
from swarmware.model.names import PATTERN_LIMIT, WILDCARDS_LIMIT, data_id
from swarmware.model.resource import Kind, Resource
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.rpc import IN_WORK_LIMIT
from swarmware.module.streamwriter import STREAM_SLOT_BYTES, STREAM_SLOTS
from swarmware.module.writer import BOARD_SLOT_BYTES, BOARD_SLOTS
from swarmware.node.master.master import APPLICATIONS_LIMIT
from swarmware.node.master.record import Holder, RecordFile
from swarmware.testing.tmpnode import make_node
from swarmware.transport.appfile.table import AppTable
from swarmware.transport.delivery.duplicates import HOLD_NS
from swarmware.transport.delivery.outbox import GRACE_NS, LOCAL, REMOTE
from swarmware.transport.delivery.outbox import WINDOW as MESSAGE_WINDOW
from swarmware.transport.messaging.ipc_transport import IPC_PATH_LIMIT
from swarmware.transport.shm import layout, readers
from swarmware.transport.shm.doorbell import Doorbell, DoorbellSenders
from swarmware.transport.shm.layout import readers_folder
from swarmware.transport.shm.notifier import ReaderNotifier
from swarmware.transport.shm.ring import RingReader, RingWriter
from swarmware.types.scalar import Text
from swarmware.types.time import AGEING, HOPS_LIMIT, LINK_SKEW_LIMIT, Conversion
from swarmware.types.tree import Rule

PAGE = (Path(__file__).parents[2] / "share" / "doc" / "protocol.md").read_text("utf-8")
TEXT = " ".join(PAGE.split())
SLOTS, SLOT_BYTES = 4, 100


def section(number: int) -> str:
    return PAGE.split(f"\n## {number}. ")[1].split("\n## ")[0]


def table(number: int, which: int = 0) -> dict[str, int]:
    """Name → offset, of a table of this section that has offsets."""
    found = section(number).split("| at |")[1 + which].split("\n\n")[0]
    return {name: int(at) for at, name in re.findall(r"^\| (\d+) \| ([a-z ,]+?) \|", found, re.M)}


HEADER = table(9)
SLOT = table(9, 1)
SLOT_DATA = 32
SLOTS_AT = 256


def word(data: bytes | bytearray, at: int) -> int:
    return int.from_bytes(data[at : at + 8], "little")


def slot_at(sequence: int) -> int:
    return SLOTS_AT + sequence % SLOTS * (-(-(32 + SLOT_BYTES) // 64) * 64)


def page_ring(frames: dict[int, bytes], newest: int) -> bytearray:
    """A ring file as the page describes it."""
    data = bytearray(SLOTS_AT + SLOTS * (-(-(32 + SLOT_BYTES) // 64) * 64))

    def put(at: int, number: int) -> None:
        data[at : at + 8] = number.to_bytes(8, "little")

    data[:8] = b"SWARMRNG"
    for name, number in {
        "version": 1,
        "slots": SLOTS,
        "slot bytes": SLOT_BYTES,
        "nonce": 5,
        "epoch": 6,
    }.items():
        put(HEADER[name], number)
    fixed = [word(data, at) for at in (0, 8, 24, 32, 40, 48, 56)]
    put(HEADER["static crc"], zlib.crc32(struct.pack("<7Q", *fixed)))
    put(HEADER["newest"], newest)
    for sequence, frame in frames.items():
        at = slot_at(sequence)
        put(at + SLOT["before"], sequence)
        data[at + SLOT_DATA : at + SLOT_DATA + len(frame)] = frame
        put(at + SLOT["meta"], zlib.crc32(frame, sequence & 0xFFFF_FFFF) << 32 | len(frame))
        put(at + SLOT["after"], sequence)
    return data


def test_ring_made_by_page_is_read_by_library(tmp_path: Path) -> None:
    path = tmp_path / "nav.pose.ring"
    frames = {n: bytes([n % 256]) * n for n in range(7, 11)}
    path.write_bytes(page_ring(frames, 10))
    with RingReader(path, after=0) as reader:
        assert reader.newest() == frames[10]
        # the oldest slot is what the writer fills next
        assert [reader.next(), reader.next(), reader.next()] == [frames[8], frames[9], frames[10]]
        assert (reader.next(), reader.lost) == (None, 7)


@pytest.mark.parametrize("at", ["before", "after", "meta"])
def test_frame_that_is_being_overwritten_is_not_read(tmp_path: Path, at: str) -> None:
    path = tmp_path / "nav.pose.ring"
    data = page_ring({9: b"nine", 10: b"ten"}, 10)
    data[slot_at(10) + SLOT[at]] ^= 1
    path.write_bytes(data)
    with RingReader(path) as reader, pytest.raises(WireError, match="never complete"):
        reader.newest()


def test_ring_written_by_library_is_as_page_says(tmp_path: Path) -> None:
    path = tmp_path / "nav.pose.ring"
    with RingWriter(path, slots=SLOTS, slot_bytes=SLOT_BYTES) as writer:
        for number in range(6):
            writer.write(f"frame {number}".encode())
        data = path.read_bytes()
        assert len(data) == len(page_ring({}, 0))
        newest = word(data, HEADER["newest"])
        assert newest == 6
        for sequence in range(3, 7):
            at = slot_at(sequence)
            meta = word(data, at + SLOT["meta"])
            frame = data[at + SLOT_DATA : at + SLOT_DATA + (meta & 0xFFFF_FFFF)]
            assert frame == f"frame {sequence - 1}".encode()
            assert meta >> 32 == zlib.crc32(frame, sequence)
            assert word(data, at + SLOT["before"]) == word(data, at + SLOT["after"]) == sequence
        assert word(data, HEADER["pid"]) == os.getpid()
        stat = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
        assert word(data, HEADER["start"]) == int(stat[22 - 3])
        boot = int(Path("/proc/sys/kernel/random/boot_id").read_text().strip().replace("-", ""), 16)
        assert word(data, HEADER["boot low"]) | word(data, HEADER["boot high"]) << 64 == boot
        with path.open() as other, pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_SH | fcntl.LOCK_NB)
        first = data
    assert word(path.read_bytes(), HEADER["pid"]) == 0
    with path.open("rb") as old, RingWriter(path, slots=SLOTS, slot_bytes=2 * SLOT_BYTES):
        assert word(old.read(SLOTS_AT), HEADER["moved"]) != 0
        data = path.read_bytes()
        assert word(data, HEADER["epoch"]) == word(first, HEADER["epoch"])
        assert word(data, HEADER["nonce"]) != word(first, HEADER["nonce"])
        assert word(data, HEADER["first"]) == word(data, HEADER["newest"]) == 6


def test_doorbells_ring_both_ways(tmp_path: Path) -> None:
    bells = tmp_path / "bells"
    readers = readers_folder(tmp_path / "nav.pose.ring")
    assert readers.name == "nav.pose.readers"
    with Doorbell(bells) as doorbell, ReaderNotifier(readers, DoorbellSenders(bells)) as ours:
        ours.add(doorbell.name)
        assert doorbell.name == f"{os.getpid()}-0"
        for entry in readers.iterdir():  # by the page
            fd = os.open(bells / entry.name, os.O_WRONLY | os.O_NONBLOCK)
            assert os.write(fd, b"\1") == 1
            os.close(fd)
        assert doorbell.drain()
        os.mkfifo(bells / "4711-0", 0o600)
        fifo = os.open(bells / "4711-0", os.O_RDWR | os.O_NONBLOCK)
        (readers / "4711-0").touch()
        os.utime(readers)
        doorbells = DoorbellSenders(bells)
        with ReaderNotifier(readers, doorbells) as writer:
            writer.notify()
        assert os.read(fifo, 100) == b"\1"
        doorbells.close()
        os.close(fifo)


def test_the_application_file_of_the_page_is_one(tmp_path: Path) -> None:
    text = re.search(r"```application-file\n(.*?)```", PAGE, re.S)
    assert text is not None
    path = tmp_path / "apps" / "listener#1.toml"
    path.parent.mkdir()
    path.write_text(text[1])
    table = AppTable(tmp_path)
    table.refresh(probe=True)
    assert list(table) == [], "nobody holds its lock"
    with path.open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        table.refresh(probe=True)
        (entry,) = table
    assert (entry.id, entry.reads) == ("listener#1", ("/uav1/nav/pose",))
    assert entry.serves[0].data_id == data_id("cmd/echo", "Text")
    assert entry.provides[0].kind is Kind.COMMAND


def test_record_of_master_is_as_page_says(tmp_path: Path) -> None:
    record = RecordFile(tmp_path / "master.lock")
    record.write_holder(Holder(3, 4711, 123456, "register#1"))
    record.request_leadership(4712, 123457)
    record.close()
    data = (tmp_path / "master.lock").read_bytes()
    at = table(18)
    assert word(data, at["epoch"]) == 3
    assert int.from_bytes(data[at["pid"] : at["start"]], "little") == 4711
    assert word(data, at["start"]) == 123456
    assert data[at["label"] : at["checksum"]] == b"register#1".ljust(48, b"\0")
    checksum = zlib.crc32(data[: at["checksum"]])
    assert int.from_bytes(data[at["checksum"] : at["checksum"] + 4], "little") == checksum
    assert struct.unpack_from("<I", data, at["candidate pid"]) == (4712,)
    assert word(data, at["candidate start"]) == 123457


def mark(descriptor: dict[str, object], lost: bool) -> int:
    fields = b"".join(map(msgspec.msgpack.encode, (part for item in descriptor.items() for part in item)))
    data = b"\x92\xde" + len(descriptor).to_bytes(2, "big") + fields + msgspec.msgpack.encode(lost)
    return int.from_bytes(blake2b(data, digest_size=8).digest(), "little")


def test_structure_made_by_page_has_our_digest() -> None:
    pose: dict[str, object] = {
        "path": "nav/pose", "type": "Pose", "rate_hz": 10.0, "category": "periodic", "link": "tick",
    }  # fmt: skip
    note: dict[str, object] = {
        "path": "cmd/note", "kind": "command", "type": "Text", "access": "rw", "category": "conditional",
        "link": "request", "owner": "listener",
    }  # fmt: skip
    dictionary = re.search(r"```structure-dictionary\n([0-9a-f]+)\n```", PAGE)
    assert dictionary is not None
    deflate = zlib.compressobj(zdict=bytes.fromhex(dictionary[1]))
    data = deflate.compress(msgspec.msgpack.encode([[pose], [note], ["old/path"], []])) + deflate.flush()
    index = Index([leaf(Resource(path="old/path", type="Text"))])
    for coded in (data, zlib.compress(msgspec.msgpack.encode([[], [], []]))):
        structure.decode(coded).apply(index)
    assert index.digest == mark(pose, False) ^ mark(note, True)
    epoch, digest = 0x1234_5678, index.digest
    assert "(digest ^ digest >> 32 ^ epoch · 0x9E3779B1) mod 2³²" in TEXT
    assert structure.version(epoch, digest) == (digest ^ digest >> 32 ^ epoch * 0x9E3779B1) % 2**32


def test_digest_of_subscription_is_that_of_page() -> None:
    patterns, rule = ["nav/*", "power/battery"], Rule("power/**", 0.1, 1.0, 5.0)
    data = msgspec.msgpack.encode([patterns, [["power/**", 0.1, 1.0, 5.0]]])
    made = int.from_bytes(blake2b(data, digest_size=8).digest(), "little")
    assert make_subscription(frozenset(patterns), (rule,)).digest == made


def test_hash_of_mission_is_that_of_page() -> None:
    texts = ["mission.toml", "name = 'é'"]
    data = b"".join(len(t.encode()).to_bytes(8, "little") + t.encode() for t in texts)
    assert content_hash(*texts) == blake2b(data, digest_size=16).hexdigest()


def test_bound_of_conversion_is_that_of_page() -> None:
    function = Conversion("uav1", "main", 1, 1, 500, 1e-5, 10**9, 2000, 100, 1e-6, 0)
    away_s = 7.0
    bound = 2000 + 1e9 * (1e-6 * away_s + 5.196e-8 * away_s**1.5)
    assert function.bound_at_ns(8 * 10**9) == pytest.approx(bound, abs=1)
    assert function.to_remote(8 * 10**9) == 8 * 10**9 + 500 + round(1e-5 * 7e9)
    assert "5.196 · 10⁻⁸" in TEXT
    assert AGEING == 5.196e-8


def test_the_figures_of_the_services_are_ours() -> None:
    mission, tree, health = MissionConfig(), TreeConfig(), HealthConfig()
    for words in (
        f"On the same node it is {LOCAL.initial_ns // 10**6} ms to {LOCAL.max_ns // 10**6} ms",
        f"To another node it is {REMOTE.initial_ns // 10**6} ms until a round trip was measured",
        f"{REMOTE.min_ns // 10**6} ms to {REMOTE.max_ns / 1e9} s",
        f"continues for {GRACE_NS // 10**9} s from the first of these",
        f"{MESSAGE_WINDOW} messages of one data id",
        f"arrived in the last {HOLD_NS // 10**9} s",
        f"process {IN_WORK_LIMIT} requests of one path",
        f"is lost after {tree.lost_s:g} s.",
        f"After {tree.expire_s:g} s it is removed, or has the descriptor of the template again",
        f"one of the owner's last {structure.HISTORY}",
        f"at most {structure.PATHS_LIMIT // 1000} 000 resources",
        f"buffers later ones ({REORDER_WINDOW} from `first` on",
        f"at most {LANE.count_max} notifications and {LANE.window_max // 1024:.0f} KiB unacknowledged",
        f"is {LANE.window_first // 1024:.0f} KiB at first. It is halved,"
        f" down to {LANE.window_min // 1024:.0f} KiB,",
        f"a notification at most {ITEMS_LIMIT} items and {BYTES_LIMIT // 1024} KiB",
        f"Changes of the structure are collected for {tree.coalesce_s} s",
        f"waits at it, for {mission.start_timeout_s:g} s",
        f"The lead is at least {mission.barrier_lead_s} s;",
        f"more than {LATE_NS / 1e9} s too late",
        f"silent for {mission.lost_after_s:g} s; while a route to it exists, for"
        f" {PATIENCE * mission.lost_after_s:g} s",
        f"The state contains the newest {['one', 'two', 'three'][ANNOUNCED - 1]}",
        f"exceeds {LINK_SKEW_LIMIT} per hop, with more than {HOPS_LIMIT} hops",
        f"it is the larger of half of the board's period and {tree.min_interval_s} s",
        f"{readers.GRANULE_NS // 10**6} ms of the time of the folder",
        f"At most {readers.ENTRIES} entries of one user count",
        "FIFO `<run_dir>/bells/<pid>-<n>`, n the first free number from 0 (any name of 1 to 47 letters",
        f"{BOARD_SLOTS} slots of {BOARD_SLOT_BYTES} bytes (boards) or {STREAM_SLOTS} of"
        f" {STREAM_SLOT_BYTES // 1000} {STREAM_SLOT_BYTES % 1000:03} (streams)",
        f"Slots of more than {layout.CHECKED_SLOT_BYTES:,} bytes have none".replace(",", " "),
        f"(path of {IPC_PATH_LIMIT} bytes at most)",
        f"{APPLICATIONS_LIMIT} applications at most",
        f"every {ASK_NS // 10**9} s (every {ASK_FIRST_NS // 10**9} s at first)",
        f"with at least {INTERVAL_NS // 10**6} ms between two writes",
        f"{health.hung_s:g} s without a heartbeat",
        f"At most {WILDCARDS_LIMIT} wildcards, {PATTERN_LIMIT} characters",
    ):
        assert words in TEXT, words
    told = re.findall(r"`(\w+)`", TEXT.split("with the kind of error: ")[1].split(", and a text")[0])
    assert set(told) == set(KINDS)


async def test_request_of_page_over_socket_is_answered(tmp_path: Path) -> None:
    async with Module("server", config_dir=make_node(tmp_path, "uav1")) as module:

        def greet(name: Text, _: Meta) -> Text:
            return Text(f"hello {name.value}")

        module.serve("cmd/greet", Text, greet, reply=Text)
        reader, writer = await asyncio.open_unix_connection(
            module.node.messaging.address.removeprefix("ipc://")
        )
        writer.write(b"\xff" + bytes(8) + b"\x7f\3\1NULL" + bytes(16) + b"\0" + bytes(31))
        ready = b"\x05READY\x0bSocket-Type\0\0\0\x06DEALER\x08Identity\0\0\0\0"
        writer.write(bytes((4, len(ready))) + ready)
        greeting = await reader.readexactly(64)
        assert (greeting[0], greeting[9], greeting[10], greeting[12:17]) == (0xFF, 0x7F, 3, b"NULL\0")
        header = struct.pack(
            "<2sBBHBBIIIIIIqII",
            *(b"SW", 1, 6, 0, 24, 6, data_id("cmd/greet", "Text")),
            *(module.node.hardware, 77, module.node.hardware, 0xFFFF_FFFF, 5, module.now_ns(), 0, 0),
        )
        frame = header + b"\x01\x04" + (2000).to_bytes(4, "little") + b"\x91\xa5world"
        writer.write(b"\x02" + len(frame).to_bytes(8, "big") + frame)
        flags, length = await reader.readexactly(2)
        assert flags == 4, "its own READY"
        assert (await reader.readexactly(length)).startswith(b"\x05READY")
        flags, length = await reader.readexactly(2)
        assert flags == 0
        answer = await reader.readexactly(length)
        writer.close()
        await writer.wait_closed()
    assert (answer[:4], answer[8:12]) == (b"SW\1\7", frame[8:12])
    assert answer[12:28] == frame[20:28] + frame[12:20], "sender and receiver exchanged"
    assert answer[28:32] == frame[28:32]
    assert msgspec.msgpack.decode(answer[48:])[:2] == [True, b"\x91\xabhello world"]
