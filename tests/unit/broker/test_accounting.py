"""Bytes and values of frames are counted where they belong: at the resource."""

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from swarmd.broker.core.traffic import ASKED_MAX, NOTIFY_ID, Counters, FrameAccounts, shares
from swarmware.model.compression import CONTAINER, Compression, Method, pack
from swarmware.model.frame import Frame, FrameKind
from swarmware.transport.delivery.answer import answer, reply
from swarmware.transport.delivery.outcome import Status
from swarmware.types import registry
from swarmware.types.traffic import ChannelTraffic
from swarmware.types.tree_exchange import TreeItem, TreeNotify

PATHS = {5: "cmd/goto", NOTIFY_ID: "sys/tree/notify"}


class Paths:
    """The addresses that are served: any table may replace them."""

    def __init__(self) -> None:
        self.version = 0
        self.table = dict(PATHS)

    def path_of(self, data_id: int) -> str | None:
        return self.table.get(data_id)


def values_in(frame: Frame) -> int:
    return FrameAccounts(Counters(), Paths()).values(frame)


def note(*items: TreeItem, kind: FrameKind = FrameKind.NOTIFY) -> Frame:
    return Frame(kind, NOTIFY_ID, payload=registry.encode(TreeNotify("uav1", 1, 1, items)))


def test_notification_is_counted_by_resources_and_values() -> None:
    frame = note(
        TreeItem("nav/goal", 1, FrameKind.BOARD, 1, 0, bytes(100)),
        TreeItem("sensor/lidar", 2, FrameKind.STREAM, 1, 0, bytes(1206)),
        TreeItem("sensor/lidar", 2, FrameKind.STREAM, 2, 0, bytes(1206)),
    )
    found = shares(frame, PATHS.get)
    assert found[:3] == [("nav/goal", 100), ("sensor/lidar", 1206), ("sensor/lidar", 1206)]
    assert found[3][0] == "sys/tree/notify"
    assert sum(size for _, size in found) == len(frame.payload)
    assert values_in(frame) == 3


def test_former_board_values_are_counted_with_boards() -> None:
    live = note(TreeItem("nav/goal", 1, FrameKind.BOARD, 1, 0, bytes(100)))
    former = msgspec.structs.replace(live, kind=FrameKind.FILE)
    assert shares(former, PATHS.get) == shares(live, PATHS.get)
    assert shares(former, PATHS.get)[0] == ("nav/goal", 100)
    assert values_in(former) == 1


def test_each_container_item_counts_even_when_damaged() -> None:
    packed = pack(bytes(5000), Compression(Method.ZLIB, 6), items=26)
    kind, damaged = FrameKind.STREAM, b"\1\1\0\xff".ljust(30)
    for data, count in (
        (packed, 26),
        (pack(bytes(9), Compression(Method.ZLIB, 6)), 1),
        (damaged, 64),
        (b"", 1),
    ):
        frame = note(
            TreeItem("sensor/lidar", 2, kind, 1, 0, data, CONTAINER),
            TreeItem("nav/goal", 1, kind, 1, 0, b"1"),
        )
        found = shares(frame, PATHS.get)
        assert [name for name, _ in found].count("sensor/lidar") == count
        assert sum(size for _, size in found) == len(frame.payload)
        assert values_in(frame) == count + 1


def test_messages_are_counted_by_path_or_kind() -> None:
    assert shares(Frame(FrameKind.MESSAGE, 5, payload=b"12"), PATHS.get) == [("cmd/goto", 2)]
    assert shares(Frame(FrameKind.REPLY, 5, payload=b"12"), PATHS.get) == [("cmd/goto", 2)]
    assert shares(Frame(FrameKind.REQUEST, 6, payload=b"12"), PATHS.get) == [("request", 2)]
    assert shares(Frame(FrameKind.ACK, 5, payload=b"1"), PATHS.get) == [("ack", 1)]


def test_only_what_is_notified_counts_as_a_notification() -> None:
    assert [kind for kind in FrameKind if values_in(Frame(kind, 5))] == [
        FrameKind.BOARD,
        FrameKind.STREAM,
        FrameKind.NOTIFY,
        FrameKind.EVENT,
    ]


@given(st.sampled_from(FrameKind), st.sampled_from([5, 6, NOTIFY_ID]), st.binary(max_size=80))
def test_any_payload_is_counted_whole(kind: FrameKind, data_id: int, payload: bytes) -> None:
    frame = Frame(kind, data_id, payload=payload)
    assert sum(size for _, size in shares(frame, PATHS.get)) == len(payload)
    assert values_in(frame) >= 0


def test_table_of_counters_stays_as_it_was_made() -> None:
    counters = Counters()
    counters.datagram_sent(100, "uav2")
    counters.channel("nav/pose").sent(24)
    counters.refused.forged = 1
    links, channels, refused = counters.link_table(), counters.channel_table(), counters.refused_table()
    counters.datagram_sent(100, "uav2")
    counters.channel("nav/pose").sent(24)
    counters.refused.forged = 2
    assert [(link.platform, link.transport, link.sent_frames) for link in links] == [("uav2", "udp", 1)]
    assert [(channel.channel, channel.sent_bytes) for channel in channels] == [("nav/pose", 24)]
    assert refused.forged == 1
    assert msgspec.msgpack.encode(channels[0]) == msgspec.msgpack.encode(
        ChannelTraffic("nav/pose", sent_frames=1, sent_bytes=24)
    )


def test_queued_frame_is_counted_when_it_leaves() -> None:
    paths, counters = Paths(), Counters()
    accounts, frame = FrameAccounts(counters, paths), Frame(FrameKind.MESSAGE, 6, payload=b"12")
    assert accounts.channels(frame) == [(counters.channel("message"), 2)]
    paths.table[6] = "cmd/stop"
    paths.version += 1
    [(channel, size)] = accounts.channels(frame)
    assert channel is counters.channel("cmd/stop")
    assert size == 2


def question(sequence: int = 1) -> Frame:
    return Frame(FrameKind.MESSAGE, 5, 1, 11, 2, 0, sequence, payload=b"12")


def test_message_is_offered_repeated_and_delivered_once() -> None:
    counters = Counters()
    accounts = FrameAccounts(counters, Paths())
    accounts.offered(question(), first=True)
    accounts.offered(question(), first=False)
    done = answer(question(), Status.DELIVERED, where="uav2", stamp_ns=0)
    accounts.answered(done)
    accounts.answered(done)
    found = counters.channel("cmd/goto")
    assert (found.offered_frames, found.repeated_frames, found.repeated_bytes) == (1, 1, 2)
    assert found.delivered_frames == 1


def test_refused_message_is_not_delivered_but_reply_delivers() -> None:
    counters = Counters()
    accounts = FrameAccounts(counters, Paths())
    for sequence in (1, 2, 3):
        accounts.offered(question(sequence), first=True)
    accounts.answered(answer(question(1), Status.REFUSED, where="uav2", stamp_ns=0))
    accounts.answered(reply(question(2), FrameKind.ACK, b"garbage", 0))
    assert counters.channel("cmd/goto").delivered_frames == 0
    accounts.answered(reply(question(3), FrameKind.REPLY, b"", 0))
    assert counters.channel("cmd/goto").delivered_frames == 1


def test_questions_without_an_answer_take_a_bounded_room() -> None:
    accounts = FrameAccounts(Counters(), Paths())
    for sequence in range(2 * ASKED_MAX):
        accounts.offered(question(sequence), first=True)
    accounts.answered(reply(question(0), FrameKind.REPLY, b"", 0))
    assert accounts.channels(question())[0][0].delivered_frames == 0, "the oldest one was forgotten"
    accounts.answered(reply(question(2 * ASKED_MAX - 1), FrameKind.REPLY, b"", 0))
    assert accounts.channels(question())[0][0].delivered_frames == 1
