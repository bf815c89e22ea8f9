"""share/doc/protocol.md says what the code does: its examples and its tables."""

import re
from pathlib import Path

from swarmd.broker.config import Config
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import (
    BODY_LIMIT,
    HOPS_MAX,
    INFINITY,
    NO_ECHO,
    Beacon,
    BoardValue,
    Echo,
    Header,
    Hello,
    PlatformCode,
    RouteRow,
)
from swarmd.broker.core.beacon.beacon_rate import (
    CHANGING_HZ,
    IDLE_HZ,
    MIN_HZ,
    OVERLOAD_RATIO,
    SLOWDOWN_MAX,
    TRIGGERED_NS,
)
from swarmd.broker.core.beacon.hello_schedule import HELLO_CHANGING_NS, HELLO_NS, SLOWER
from swarmd.broker.core.beacon.parts.session_checks import CheckKind
from swarmd.broker.core.boards.published_boards import REPEATS
from swarmd.broker.core.boards.relay_cache import FURTHER_NS, OLDEST_NS, PERIOD_NS, REPEAT_NS
from swarmd.broker.core.frames.carrier_choice import CLEAN, CLEAN_NS, LOSSY
from swarmd.broker.core.frames.forwarder import LOOP_NS
from swarmd.broker.core.frames.frame_datagram import FRAME, MISSES, PACKET, RETRY_NS
from swarmd.broker.core.frames.frame_datagram import MAGIC as DATAGRAM_MAGIC
from swarmd.broker.core.frames.reliable.packet import DELAY_UNIT_NS, PACKET_MAX, RANGES_MAX
from swarmd.broker.core.frames.reliable.reassembly import SPAN_MAX
from swarmd.broker.core.frames.reliable.received_packets import ACK_DELAY_NS
from swarmd.broker.core.frames.reliable.reliable_link import BLOCKED, BLOCKED_LATER, LINK
from swarmd.broker.core.frames.reliable.reliable_links import BLOCKED_NS
from swarmd.broker.core.membership.sessions import AGAIN_NS, ALIVE_NS, ENDED_NS
from swarmd.broker.core.swarm.links.link import COST_MAX, RTT_FREE_NS, RTT_FULL_NS, RTT_PENALTY
from swarmd.broker.core.swarm.links.solicited import (
    ANSWER_SLACK_NS,
    ASK_AGAIN_NS,
    ASKS_MAX,
    ASKS_MIN,
    LOSS_MIN,
    SUSPICION,
)
from swarmd.broker.core.swarm.media.arrivals import EXPECTED_MIN as ARRIVALS_MIN
from swarmd.broker.core.swarm.media.arrivals import WINDOW as ARRIVALS
from swarmd.broker.core.swarm.media.medium import NOMINAL_BYTES, PENALTY_NS
from swarmd.broker.core.swarm.media.medium import PERFECT as MEDIUM_PERFECT
from swarmd.broker.core.swarm.media.medium_link import PERIODS as MEDIUM_PERIODS
from swarmd.broker.core.swarm.media.medium_link import PERIODS_MAX as MEDIUM_PERIODS_MAX
from swarmd.broker.core.swarm.neighbour import (
    CLOCK_HIGH_MAX,
    EXPECTED_MIN,
    FALSE_ALARM,
    FIRST_PERIOD_NS,
    LISTING_NS,
    LISTINGS,
    LONG_WINDOW,
    LOSSY_RATIO,
    MISSES_MAX,
    NOTICE_SLACK_NS,
    PERIODS,
    UNLISTED_SLACK_NS,
    WINDOW,
)
from swarmd.broker.core.swarm.neighbours.medium_table import HYSTERESIS as MEDIUM_HYSTERESIS
from swarmd.broker.core.swarm.neighbours.medium_table import LISTING_NS as MEDIA_NS
from swarmd.broker.core.swarm.neighbours.neighbour_table import (
    LISTING_EACH_NS,
    QUALITY_NS,
    QUALITY_STEP,
    WELL,
)
from swarmd.broker.core.swarm.routes.destination_routes import HELD_NS, URGENT_RATIO, WORSE_BY, WORSE_RATIO
from swarmd.broker.core.swarm.routes.routing_table import (
    BETTER_BY,
    BETTER_RATIO,
    FORWARD_AGAIN_NS,
    HOLD_NS,
    HYSTERESIS,
    REFRESH_ANYWAY,
    REFRESH_MAX_NS,
    REFRESH_NS,
    REQUEST_AGAIN_NS,
    REQUEST_FOR_NS,
    REQUESTS_MAX,
    RETRACTIONS,
    SEEK_AFTER_NS,
    SEEK_AGAIN_NS,
    SEEK_OTHER_NS,
    SOURCE_GC_NS,
    STRETCH_FROM,
    STRETCH_MAX,
)
from swarmd.broker.core.swarm.topology import CHANGING_NS, JUMPS
from swarmd.broker.core.traffic import IP_UDP_BYTES
from swarmd.broker.sockets.pair_seal import PAIR_WINDOW
from swarmd.broker.sockets.zmq.zap import DOMAIN
from swarmware.model import frame as wire
from swarmware.model.access import Role
from swarmware.model.frame import HOPS, Codec, Flag, Frame, FrameKind
from swarmware.model.names import ANY, application_id, data_id, hardware_id
from swarmware.transport.delivery.answer import with_lifetime
from swarmware.transport.delivery.parts import FORGET_NS, HELD_BYTES, PART_BYTES, SPLIT_BYTES, VALUE_LIMIT
from swarmware.transport.retransmission.rate_control import (
    BASE_NS,
    FALL_NS,
    LOSS_EXCESS,
    QUEUE_SHARE,
    TARGET_NS,
)
from swarmware.transport.security.seal import REPLAY_WINDOW, GroupKey, Opened, Opener, Sealer
from swarmware.types.registry import encode
from swarmware.types.scalar import Text
from swarmware.types.vehicle import Pose

PAGE = (Path(__file__).parents[3] / "share" / "doc" / "protocol.md").read_text("utf-8")
TEXT = " ".join(PAGE.split())
GROUP = GroupKey(3, bytes(range(32)))
SESSION = 0x0102030405060708
SECOND = 1_000_000_000
MS = 1_000_000
NONCE_PERSONS = {"swarmware tick 1", "swarmware pair 1"}


def example(name: str) -> bytes:
    """A block of hex on the page."""
    found = re.search(rf"```{name}\n([0-9a-f]+)\n```", PAGE)
    assert found is not None, name
    return bytes.fromhex(found[1])


def beacon() -> Beacon:
    return Beacon(
        hello=Hello(0x1122334455667788, 1, 7447, 42, 0, PlatformCode.UAV, "uav3"),
        echoes=(Echo(hardware_id("gcs"), 0x2A, 50_000, 255),),
        rows=(RouteRow(hardware_id("uav7"), 0x1234, 512),),
        values=(BoardValue(data_id("nav/pose", "Pose"), 12_300, True, Pose.planar(1.0, 2.0, 3.0).pack()),),
    )


def test_beacon_of_page_is_one_we_send() -> None:
    body = codec.encode(beacon())
    assert body == example("beacon-body")
    hw = hardware_id("uav3")
    clear = codec.encode_header(Header(3, hw, 1000, 123_456_789, SESSION))
    assert clear + Sealer(GROUP, hw, SESSION).seal(1000, clear, body) == example("beacon-datagram")


def test_beacon_of_page_is_one_we_take() -> None:
    data = example("beacon-datagram")
    header, start = codec.decode_header(data)
    opened = Opener(GROUP).open(
        header.epoch, header.sender_hw, header.session, header.sequence, data[:start], data[start:]
    )
    assert isinstance(opened, Opened)
    assert codec.decode(opened.body) == beacon()


def test_the_frame_of_the_page_is_ours() -> None:
    frame = Frame(
        FrameKind.MESSAGE,
        data_id("cmd/note", "Text"),
        hardware_id("gcs"),
        application_id("swarmctl", 1),
        hardware_id("uav3"),
        ANY,
        7,
        SECOND,
        flags=Flag.WANTS_ACK,
        extension=with_lifetime(2.0),
        payload=encode(Text("hello")),
    )
    assert wire.encode(frame) == example("frame")
    assert wire.decode(example("frame")) == frame


def test_the_ids_of_the_page_are_ours() -> None:
    for name, number in re.findall(r"`(\w+)\.main` (?:is )?0x([0-9a-f]{8})", PAGE):
        assert hardware_id(name) == int(number, 16)
    assert f"`nav/pose:Pose` 0x{data_id('nav/pose', 'Pose'):08x}" in PAGE
    assert f"`cmd/note:Text` (0x{data_id('cmd/note', 'Text'):08x})" in PAGE
    assert f"`swarmctl#1` (0x{application_id('swarmctl', 1):08x})" in PAGE


def test_the_kinds_of_the_page_are_ours() -> None:
    section = PAGE[PAGE.index("## 2.") : PAGE.index("## 3.")]
    rows = re.findall(r"^\| (\d+) \| ([a-z]+) \| [^|]+ \|$", section, re.M)
    told = {int(number): name for number, name in rows}
    assert told == {int(kind): kind.name.lower() for kind in FrameKind}


def test_flags_and_codecs_of_page_match_code() -> None:
    flags = {int(number) for number in re.findall(r"(\d+) (?:urgent|wants an acknowledgement|bulk)", PAGE)}
    assert flags == set(Flag)
    assert "1 reserved" in PAGE
    assert {codec.name: int(codec) for codec in Codec} == {"NONE": 0, "ZLIB": 1, "ZSTD": 2, "PACKED": 7}
    assert "1 zlib of MessagePack: used in datagrams (5.1) · 2 zstd of MessagePack: reserved" in TEXT


def test_checks_and_roles_of_page_are_ours() -> None:
    section = PAGE.split("### 3.5")[1].split("## 4.")[0]
    kinds = {int(number): name for number, name in re.findall(r"\| (\d) \| (\w+) \|", section)}
    assert kinds == {int(kind): kind.name.lower() for kind in CheckKind}
    roles = re.findall(r"(\d) (observer|node|operator|maintainer)", PAGE)
    assert {int(number): name for number, name in roles} == {int(role): role.name.lower() for role in Role}
    assert f"silent for {ENDED_NS / 1e9} s, or for {ALIVE_NS / 1e9} s" in section


def test_the_figures_of_the_page_are_ours() -> None:
    limits = Config()
    datagram = f"{22 + BODY_LIMIT + 16:,} bytes".replace(",", " ")
    for words in (
        f"the group {limits.multicast_group}, port {limits.udp_port}",
        f"one UDP datagram of at most {datagram}",
        f"{HOPS} at the sender",
        f"replay window has {REPLAY_WINDOW} numbers",
        f"is sent every {HELLO_NS // SECOND} s, every {HELLO_CHANGING_NS // SECOND} s while links change",
        f"clocks stay within ±2{power((CLOCK_HIGH_MAX << 32).bit_length() - 1)} µs",
        f"the share of the last {WINDOW} datagrams",
        f"every {LISTING_NS // SECOND} s, with more than {LISTING_NS // LISTING_EACH_NS} neighbours every"
        f" {LISTING_EACH_NS // MS} ms times their number",
        f"after {QUALITY_NS / SECOND} s when its quality has changed by {QUALITY_STEP}",
        f"0x{NO_ECHO:X}: not given",
        f"0x{INFINITY:X} retracts the route",
        f"A changed value is in the next {['one', 'two', 'three'][REPEATS - 1]} datagrams",
        f"1 to {HOPS_MAX}; any other number makes the body invalid",
        f"with a quality of {WELL} or more",
        f"again {ASK_AGAIN_NS // MS} ms after each request",
        f"(`answer`, in ms: {TRIGGERED_NS // MS} ms, the gap",
        f"the round trip and {ANSWER_SLACK_NS // MS} ms have passed since the last of"
        f" {ASKS_MIN} to {ASKS_MAX} requests",
        f"in less than {round(100 * SUSPICION)} % of the periods",
        f"counts with a loss of 1/{round(1 / LOSS_MIN)}",
        f"costs at least {WORSE_RATIO} times as much as the way over this node, and {WORSE_BY} more",
        f"a quality of {WELL} or more counts as 255",
        f"at most once in {PERIOD_NS / SECOND} s, and {FURTHER_NS / SECOND} s more for each hop",
        f"is more than {OLDEST_NS // SECOND} s old",
        f"may be relayed again after {REPEAT_NS / SECOND} s",
        f"at {limits.tick_hz:g} Hz while its boards have subscribers or it relays boards of others,"
        f" at {CHANGING_HZ:g} Hz for {CHANGING_NS // SECOND} s after a link came up or went down,"
        f" otherwise at {IDLE_HZ:g} Hz",
        f"down to {MIN_HZ} Hz, where",
        f"is sent within {TRIGGERED_NS // MS} ms",
        f"later than {['a fifth'][round(5 * OVERLOAD_RATIO) - 1]} of their period",
        f"divides its rate by up to {SLOWDOWN_MAX:g}",
        f"grows by {['a quarter'][round(4 * (SLOWER - 1)) - 1]}, the node sends a hello",
        f"over the last {WINDOW} and at least {EXPECTED_MIN} expected",
        f"no echo arrives for {LISTINGS} listing periods and {UNLISTED_SLACK_NS // SECOND} s",
        f"{limits.link_timeout_s:g} s without a datagram, or after {PERIODS} periods of the sender",
        f"the loss of the last {LONG_WINDOW} datagrams",
        f"{FALSE_ALARM:g} divided by the number of neighbours; at most {MISSES_MAX}",
        f", and then {LOSSY_RATIO:g} s at least",
        f"in a replay window of {PAIR_WINDOW}",
        f"above {SPLIT_BYTES >> 10} KiB is split",
        f"up to {VALUE_LIMIT >> 20} MiB",
        f"{PART_BYTES >> 10} KiB of the payload",
        f"holds {HELD_BYTES >> 20} MiB of incomplete values",
        f"without a new part for {FORGET_NS // SECOND} s",
        f"its next beacons, at most every {AGAIN_NS // MS} ms",
        f"at most {COST_MAX}",
        f"better by more than {HYSTERESIS}",
        f"every {REQUEST_AGAIN_NS / SECOND} s, for {REQUEST_FOR_NS // SECOND} s",
        f"(once in {FORWARD_AGAIN_NS / SECOND} s per destination)",
        f"metric 0xFFFF {['once', 'twice'][RETRACTIONS - 1]}",
        f"at most by 2¹⁵, {['one', 'two', 'three', 'four'][JUMPS - 1]} times",
        f"at least {URGENT_RATIO} times the last advertised one and {WORSE_BY} is",
        f"larger by a ratio of at least {WORSE_RATIO} and {WORSE_BY},",
        f"not with a newer one, for {HELD_NS // SECOND} s",
        f"worse by {['a quarter'][round(4 * BETTER_RATIO) - 1]} of that, at least by {BETTER_BY}; once",
        f"in {SEEK_AGAIN_NS / SECOND:g} s per destination and neighbour",
        f"another neighbour after {SEEK_OTHER_NS / SECOND} s, with S + 1",
        f"it compares {SEEK_AFTER_NS / SECOND} s later",
        f"(once in {FORWARD_AGAIN_NS / SECOND} s per destination, {REQUESTS_MAX} in a beacon at most)",
        f"every {REFRESH_NS / SECOND} s per hop of distance",
        f"without one after {REFRESH_ANYWAY} such periods",
        f"(metric / 256), at the latest after {REFRESH_MAX_NS // SECOND} s",
        f"with the number of nodes above {STRETCH_FROM}, up to {STRETCH_MAX:g} times",
        f"does not change for {HOLD_NS // SECOND} s is lost",
        f"forgotten {SOURCE_GC_NS // SECOND} s after",
        f"after {MISSES_MAX + PERIODS - 2} times the maximum period",
        f"at least {PERIODS * FIRST_PERIOD_NS / SECOND} s, plus {NOTICE_SLACK_NS / SECOND} s",
        f"ZAP domain is `{DOMAIN}`",
        f"A frame that returns within {LOOP_NS // MS} ms",
        f"as one datagram of at most {datagram}",
        f"clear header: 0x{DATAGRAM_MAGIC:X} ‖ content {FRAME}",
        f"with content {PACKET},",
        f"smoothed loss of {LOSSY:.0%}".replace("%", " %"),
        f"below {CLEAN:.0%}".replace("%", " %") + f" for {CLEAN_NS // SECOND} s",
        f"acknowledge {BLOCKED} probes in a row, {BLOCKED_LATER} where it has",
        f"A packet has at most {PACKET_MAX // 1000} {PACKET_MAX % 1000} bytes",
        f"up to {SPAN_MAX // 1000} {SPAN_MAX % 1000:03}",
        f"at most {RANGES_MAX} ranges",
        f"in {DELAY_UNIT_NS // 1000} µs",
        f"within {ACK_DELAY_NS // MS} ms",
        f"when one {['three'][LINK.packet_threshold - 3]} numbers higher",
        f"and {LINK.slack_ns // MS} ms, afterwards {['twice'][LINK.doublings_max - 1]} that",
        f"The target is {FALL_NS // MS} ms less that minimum, at least"
        f" {['a quarter'][QUEUE_SHARE - 4]} of it and the time of two packets, and at most"
        f" {TARGET_NS // MS} ms",
        f"over the last {BASE_NS // SECOND} to {2 * BASE_NS // SECOND} s",
        f"by {LOSS_EXCESS * 100:.0f} percentage points",
        f"the frames of {['one', 'two'][MISSES - 1]} datagrams in a row",
        f"payload + {IP_UDP_BYTES} (IPv4 20, UDP 8)",
        f"r: {MEDIUM_PERFECT} for each {PENALTY_NS // MS} ms that {NOMINAL_BYTES} bytes take",
        f"a round trip of {RTT_FREE_NS // MS} ms, rising to {RTT_PENALTY} at {RTT_FULL_NS // MS} ms",
        f"reports every {MEDIA_NS / SECOND} s by which media",
        f"the share of the last {ARRIVALS} datagrams (at least {ARRIVALS_MIN} are expected)",
        f"or for {MEDIUM_PERIODS} periods of the sender",
        f"(divided by the square of that share, at most {MEDIUM_PERIODS_MAX:.0f})",
        f"Another one must be better by more than {MEDIUM_HYSTERESIS}",
    ):
        assert words in TEXT, words
    assert RETRY_NS == BLOCKED_NS == 60 * SECOND, "the connection for a minute"
    assert set(re.findall(r'person = "([^"]+)"', PAGE)) >= NONCE_PERSONS


def power(exponent: int) -> str:
    return str(exponent).translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))
