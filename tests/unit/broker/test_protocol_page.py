"""share/doc/protocol.md says what the code does: its examples and its tables."""

import re
from pathlib import Path

from swarmd.broker.core.admission.sessions import ALIVE_NS, ENDED_NS
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import (
    BODY_LIMIT,
    Beacon,
    BoardValue,
    Echo,
    Header,
    Hello,
    PlatformKind,
    RouteRow,
)
from swarmd.broker.core.beacon.session_checks import CheckKind
from swarmd.broker.core.beacon_protocol import DIRECT_COST, DIRECT_NS
from swarmd.broker.core.topology.neighbour import (
    EXPECTED_MIN,
    FALSE_ALARM,
    LISTINGS,
    LONG_WINDOW,
    PERIODS,
    WINDOW,
)
from swarmd.broker.core.topology.routing_table import (
    HOLD_NS,
    HYSTERESIS,
    REFRESH_MAX_NS,
    REFRESH_NS,
    REQUEST_AGAIN_NS,
    REQUEST_FOR_NS,
    SOURCE_GC_NS,
    STRETCH_FROM,
    STRETCH_MAX,
)
from swarmware.model import frame as wire
from swarmware.model.access import Role
from swarmware.model.frame import HOPS, Codec, Flag, Frame, FrameKind
from swarmware.model.names import ANY, application_id, data_id, hardware_id
from swarmware.transport.delivery.answer import with_lifetime
from swarmware.transport.security import REPLAY_WINDOW, GroupKey, Opened, Opener, Sealer
from swarmware.types.registry import encode
from swarmware.types.scalar import Text
from swarmware.types.vehicle import Pose

PAGE = (Path(__file__).parents[3] / "share" / "doc" / "protocol.md").read_text("utf-8")
GROUP = GroupKey(3, bytes(range(32)))
SESSION = 0x0102030405060708
SECOND = 1_000_000_000


def example(name: str) -> bytes:
    """A block of hex on the page."""
    found = re.search(rf"```{name}\n([0-9a-f]+)\n```", PAGE)
    assert found is not None, name
    return bytes.fromhex(found[1])


def beacon() -> Beacon:
    return Beacon(
        hello=Hello(0x1122334455667788, 1, 7447, 42, 0, PlatformKind.UAV, "uav3"),
        echoes=(Echo(hardware_id("gcs"), 0x2A, 50_000, 255),),
        rows=(RouteRow(hardware_id("uav7"), 0x1234, 512),),
        values=(BoardValue(data_id("nav/pose", "Pose"), 12_300, True, Pose.planar(1.0, 2.0, 3.0).pack()),),
    )


def test_the_beacon_of_the_page_is_the_one_we_send() -> None:
    body = codec.encode(beacon())
    assert body == example("beacon-body")
    hw = hardware_id("uav3")
    clear = codec.encode_header(Header(3, hw, 1000, 123_456_789, SESSION))
    assert clear + Sealer(GROUP, hw, SESSION).seal(1000, clear, body) == example("beacon-datagram")


def test_the_beacon_of_the_page_is_one_we_take() -> None:
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


def test_the_flags_and_codecs_of_the_page_are_ours_and_the_others_are_called_reserved() -> None:
    flags = {int(number) for number in re.findall(r"(\d+) (?:urgent|wants an acknowledgement)", PAGE)}
    assert flags == set(Flag)
    assert "1 and 8 reserved" in PAGE
    assert {codec.name: int(codec) for codec in Codec} == {"NONE": 0, "ZLIB": 1, "ZSTD": 2, "PACKED": 7}
    assert "1 zlib and 2 zstd of MessagePack: reserved" in PAGE


def test_the_checks_and_roles_of_the_page_are_ours() -> None:
    section = PAGE.split("### 3.5")[1].split("## 4.")[0]
    kinds = {int(number): name for number, name in re.findall(r"\| (\d) \| (\w+) \|", section)}
    assert kinds == {int(kind): kind.name.lower() for kind in CheckKind}
    roles = re.findall(r"(\d) (observer|node|operator|maintainer)", PAGE)
    assert {int(number): name for number, name in roles} == {int(role): role.name.lower() for role in Role}
    assert f"silent for {ENDED_NS / 1e9} s, or for {ALIVE_NS / 1e9} s" in section
    assert f"up for {DIRECT_NS // 10**9} s at a cost of {DIRECT_COST} at most" in PAGE


def test_the_figures_of_the_page_are_ours() -> None:
    for words in (
        f"{HOPS} at the sender",
        f"{REPLAY_WINDOW} numbers back",
        f"over the last {WINDOW}",
        f"at least {EXPECTED_MIN} expected",
        f"none comes for {LISTINGS} listing periods and 1 s",
        f"{PERIODS} periods of the sender",
        f"the last {LONG_WINDOW} datagrams",
        f"{FALSE_ALARM:g} divided by the number of neighbours",
        f"with the number of nodes above {STRETCH_FROM}, up to {STRETCH_MAX:g} times",
        f"better by more than {HYSTERESIS}",
        f"every {REQUEST_AGAIN_NS / SECOND} s, for {REQUEST_FOR_NS // SECOND} s",
        f"every {REFRESH_NS / SECOND} s per hop of distance",
        f"(metric / 256), at most {REFRESH_MAX_NS // SECOND} s",
        f"stands still for {HOLD_NS // SECOND} s is lost",
        f"forgotten {SOURCE_GC_NS // SECOND} s after",
        f"At most {22 + BODY_LIMIT + 16:,} bytes".replace(",", " "),
    ):
        assert words in PAGE, words
