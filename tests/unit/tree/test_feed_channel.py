"""Channels of feeds: rates of streams, buffers in bytes and seconds, recovery after an outage."""

import pytest

from swarmd.tree.core.notification.feed import Feed
from swarmd.tree.core.notification.feed_channel import CATCH_UP, FeedChannel
from swarmware.model.frame import FrameKind
from swarmware.model.resource import Kind, Resource
from swarmware.types.channel import ChannelProtocol, ChannelSettings
from swarmware.types.tree import Rule
from swarmware.types.tree_exchange import TreeItem

S = 1_000_000_000
STREAM = Resource(path="sensor/packets", kind=Kind.STREAM, type="Blob")
EVENT = Resource(path="health/faults", kind=Kind.EVENT, type="Text")


def item(sequence: int, stamp_ns: int, size: int = 100) -> TreeItem:
    return TreeItem("sensor/packets", 7, FrameKind.STREAM, sequence, stamp_ns, bytes(size))


def feed(resource: Resource = STREAM, **settings: float) -> Feed:
    one = Feed(resource, Rule("**"), 0)
    one.set_channel(ChannelSettings(**settings))  # type: ignore[arg-type]
    return one


def drain(one: Feed, begin_ns: int, end_ns: int) -> list[tuple[int, int]]:
    """Time and sequence of all that is sent on a link that takes everything."""
    sent, now_ns = [], begin_ns
    while (due_ns := one.due_ns()) is not None and max(due_ns, now_ns) <= end_ns:
        now_ns = max(due_ns, now_ns)
        taken = one.take(now_ns, 32, 10**9)
        sent += [(now_ns, each.sequence) for each in taken]
        one.on_acknowledged(taken, now_ns)
    return sent


@pytest.mark.parametrize(
    ("written_hz", "max_hz"), [(30, 5.0), (30, 7.0), (753, 100.0), (10, 10.0), (5, 10.0)]
)
def test_limited_stream_sends_at_rate_counting_rest(written_hz: int, max_hz: float) -> None:
    one, sent = feed(max_hz=max_hz), []
    for sequence in range(20 * written_hz):
        now_ns = sequence * S // written_hz
        one.offer(item(sequence, now_ns))
        sent += drain(one, now_ns, now_ns + S // written_hz - 1)
    sent += drain(one, 20 * S, 21 * S)
    assert len(sent) == pytest.approx(20 * min(max_hz, written_hz), abs=2)
    assert [sequence for _, sequence in sent] == sorted(sequence for _, sequence in sent)
    assert one.held_back == 20 * written_hz - len(sent)
    assert one.dropped == 0


def test_limited_stream_sends_newest_items() -> None:
    one = feed(max_hz=5.0)
    for sequence in range(300):
        now_ns = sequence * S // 30
        one.offer(item(sequence, now_ns))
        for sent_ns, sent in drain(one, now_ns, now_ns + S // 30 - 1):
            assert sent_ns - sent * S // 30 < S // 30


def test_limited_stream_catches_up_at_double_rate() -> None:
    one = feed(max_hz=10.0)
    for sequence in range(100):
        one.offer(item(sequence, sequence * S // 10))  # ten seconds without a link
    sent = []
    for sequence in range(100, 300):
        now_ns = sequence * S // 10
        one.offer(item(sequence, now_ns))
        sent += drain(one, now_ns, now_ns + S // 10 - 1)
    assert [sequence for _, sequence in sent] == list(range(300)), "in order, nothing left out"
    first_s = [sequence for sent_ns, sequence in sent if sent_ns < 11 * S]
    assert len(first_s) == pytest.approx(CATCH_UP * 10, abs=2)
    level_ns = next(sent_ns for sent_ns, sequence in sent if sequence * S // 10 > sent_ns - S // 10)
    assert 19 * S < level_ns < 22 * S


def test_a_buffer_keeps_the_newest_within_its_bytes() -> None:
    one = feed(buffer_bytes=1000)
    for sequence in range(50):
        one.offer(item(sequence, sequence))
    assert one.waiting == (10, 1000)
    assert one.dropped == 40
    assert [sequence for _, sequence in drain(one, S, S)] == list(range(40, 50))


def test_buffer_keeps_one_oversized_item() -> None:
    one = feed(buffer_bytes=10)
    one.offer(item(1, 0))
    one.offer(item(2, 0))
    assert one.waiting == (1, 100)
    assert one.dropped == 1


def test_a_buffer_keeps_the_newest_of_its_seconds() -> None:
    one = feed(buffer_s=2.0)
    for sequence in range(100):
        one.offer(item(sequence, sequence * S // 10))
    assert one.waiting[0] == 21
    assert one.dropped == 79


def test_item_that_became_too_old_is_not_sent() -> None:
    one = feed(buffer_s=2.0)
    one.offer(item(1, 0))
    one.offer(item(2, S))
    assert one.take(2 * S + S // 2, 32, 10**9) == [item(2, S)]
    assert one.dropped == 1
    one.offer(item(3, 3 * S))
    assert one.take(9 * S, 32, 10**9) == []
    assert one.due_ns() is None


def test_smaller_buffer_holds_at_once() -> None:
    one = feed()
    for sequence in range(50):
        one.offer(item(sequence, 0))
    one.set_channel(ChannelSettings(buffer_bytes=500))
    assert one.waiting == (5, 500)
    one.set_channel(ChannelSettings(buffer_bytes=4 * 2**20))
    for sequence in range(20_000):
        one.offer(item(sequence, 0))
    assert one.waiting[0] == 20_005


def test_stream_of_rate_zero_counts_omissions() -> None:
    one = feed(max_hz=0.0)
    one.offer(item(1, 0))
    assert one.due_ns() is None
    assert (one.held_back, one.waiting) == (1, (0, 0))
    one.set_channel(ChannelSettings())
    one.offer(item(2, S))
    assert [sequence for _, sequence in drain(one, S, S)] == [2]


def test_events_wait_for_turn_without_omission() -> None:
    one = feed(EVENT, max_hz=2.0)
    for sequence in range(10):
        one.offer(item(sequence, 0))
    sent = drain(one, 0, 100 * S)
    assert [sequence for _, sequence in sent] == list(range(10))
    assert sent[-1][0] == pytest.approx(4.5 * S, abs=S // 10)
    assert one.held_back == 0


def test_backward_clock_does_not_silence_limited_stream() -> None:
    one = feed(max_hz=1.0)
    for sequence, stamp_ns in enumerate((1000 * S, 1001 * S, 5 * S, 6 * S, 7 * S)):
        one.offer(item(sequence, stamp_ns))
    assert one.waiting[0] == 5


def test_images_as_video_are_not_notified() -> None:
    for settings_ in (ChannelSettings(protocol=ChannelProtocol.RTP), ChannelSettings(compression="h264")):
        images, packets = (
            Feed(Resource(path="sensor/packets", kind=Kind.STREAM, type=name), Rule("**"), 0)
            for name in ("Image", "Blob")
        )
        for one in (images, packets):
            one.set_channel(settings_)
            one.offer(item(0, S))
        assert (images.due_ns(), images.held_back) == (None, 1)
        assert packets.due_ns() is not None
        assert packets.channel == Feed(STREAM, Rule("**"), 0).channel
        images.set_channel(ChannelSettings())
        images.offer(item(1, S))
        assert images.due_ns() is not None


def test_what_waits_obeys_a_new_limit_too() -> None:
    one = feed(buffer_bytes=1_000_000)
    for sequence in range(100):
        one.offer(item(sequence, sequence * S // 100))
    one.set_channel(ChannelSettings(10.0, buffer_bytes=1_000_000))
    assert (one.waiting, one.held_back) == ((10, 1000), 90)
    stamps = [one.take(2 * S, 32, 10**9)[0].stamp_ns for _ in range(10)]
    assert stamps == [index * S // 10 for index in range(10)]
    one.set_channel(ChannelSettings(0.0))
    one.offer(item(100, S))
    assert one.waiting == (0, 0)


def test_auto_is_zstd_1_and_other_methods_stay() -> None:
    for text, taken in (("auto", "zstd:1"), ("zstd:3", "zstd:3"), ("none", "none")):
        assert str(FeedChannel.of(ChannelSettings(compression=text)).compression) == taken
