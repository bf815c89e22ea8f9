"""Whatever members send, in whatever order: the protocol takes or refuses it, and its own beacons go on."""

from typing import Final

from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from tests.simulation.seeds import examples

from swarmd.broker.config import Config
from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import (
    BODY_LIMIT,
    Beacon,
    BoardValue,
    Echo,
    Header,
    Hello,
    MemberRow,
    NeighbourRequest,
    PlatformCode,
    RelayedValue,
    RouteRow,
    SequenceRequest,
)
from swarmd.broker.core.beacon.hello_schedule import NodeIdentity
from swarmd.broker.core.beacon.parts.structure_parts import StructurePart
from swarmd.broker.core.beacon_protocol import BeaconProtocol
from swarmd.broker.core.swarm.topology import Topology
from swarmd.broker.core.traffic import Counters
from swarmware.errors import WireError
from swarmware.model.frame import Frame, FrameKind
from swarmware.model.frame import encode as encode_frame
from swarmware.model.names import data_id, hardware_id
from swarmware.types.net import BoardPublication, BoardSubscription, StructureBroadcast, TreePlan
from swarmware.types.registry import encode
from swarmware.types.time import TimingBatch, TimingSample

SECOND: Final = 1_000_000_000
ME: Final = "uav1"
OTHERS: Final = ("uav2", "uav3", "uav4")
POSE: Final = data_id("nav/pose", "Pose")

U8, U16, U32 = st.integers(0, 255), st.integers(0, 0xFFFF), st.integers(0, 0xFFFF_FFFF)
U64 = st.integers(0, 2**64 - 1)
KNOWN: Final = tuple(hardware_id(name) for name in (ME, *OTHERS))
NODES = st.sampled_from([*KNOWN, 0, 0xFFFF_FFFF]) | U32
DATA = st.just(POSE) | U32
AGES = st.integers(0, 4_000_000_000)
PAYLOADS = st.binary(max_size=300)


def many(elements: st.SearchStrategy[object], most: int = 12) -> st.SearchStrategy[tuple[object, ...]]:
    return st.lists(elements, max_size=most).map(tuple)


def hellos(name: str) -> st.SearchStrategy[Hello]:
    return st.builds(
        Hello,
        boot_id=st.integers(0, 2**64 - 1),
        clock_high=st.just(0) | st.integers(-(2**31), 2**31 - 1),
        tcp_port=U16,
        tree_version=U32,
        mission=U32,
        kind=st.sampled_from(PlatformCode),
        name=st.just(name) | st.sampled_from([ME, "", "UAV", "uav2.", "uav2..x", "ä", "x" * 150]),
        curve_public=st.sampled_from([b"", bytes(32)]),
        period_ms=U16,
        listing_ms=U16,
    )


def beacons(name: str) -> st.SearchStrategy[Beacon]:
    return st.builds(
        Beacon,
        hello=st.none() | hellos(name),
        echoes=many(st.builds(Echo, NODES, U8, st.integers(0, 0xFF_FFFF), U8)),
        rows=many(st.builds(RouteRow, NODES, U16, U16)),
        requests=many(st.builds(SequenceRequest, NODES, U16, U8)),
        members=many(st.builds(MemberRow, NODES, U32, st.just(PlatformCode.UAV), st.sampled_from(OTHERS))),
        values=many(st.builds(BoardValue, DATA, AGES, st.booleans(), PAYLOADS), 4),
        relays=many(
            st.builds(
                RelayedValue, NODES, DATA, st.integers(-(2**47), 2**47 - 1), AGES, U8, st.booleans(), PAYLOADS
            ),
            4,
        ),
        structure=st.none() | st.builds(StructurePart, U32, U64, U64, PAYLOADS),
        structure_questions=many(NODES),
        neighbour_requests=many(st.builds(NeighbourRequest, NODES, NODES, U16, U8)),
    )


@st.composite
def datagrams(draw: st.DrawFn) -> tuple[Header, bytes, int]:
    """A header, a body, and the time since the one before."""
    name = draw(st.sampled_from((*OTHERS, ME)))
    sequence = draw(st.integers(1, 40) | U32)
    tx_us = draw(st.integers(0, 10_000_000) | U32)
    session = draw(st.none() | st.integers(0, 3) | st.integers(0, 2**64 - 1))
    header = Header(0, draw(st.just(hardware_id(name)) | NODES), sequence, tx_us, session)
    body = bytearray(codec.encode(draw(beacons(name))))
    for _ in range(draw(st.sampled_from([0, 0, 0, 1, 3]))):
        body[draw(st.integers(0, len(body) - 1))] = draw(U8)
    return header, bytes(body), draw(st.sampled_from([0, 1, 10**6, 10**8, 3 * 10**9, 10**11]))


def protocol() -> BeaconProtocol:
    mine = BeaconProtocol(
        NodeIdentity(hardware_id(ME), ME, "main", PlatformCode.UAV, 1, b""),
        Topology(hardware_id(ME), 1, SECOND, 0),
        Counters(),
        Config(relay_bytes_s=3000.0),
    )
    wants = tuple(BoardSubscription(name, "nav/pose", "Pose", POSE) for name in OTHERS)
    own = StructureBroadcast(ME, 1, 2, 3, b"changes")
    mine.set_plan(TreePlan(1, (BoardPublication("nav/pose", POSE, "Pose"),), wants, 0, own, OTHERS))
    return mine


@settings(max_examples=examples(15, 40), deadline=None, phases=[Phase.generate])
@given(st.lists(datagrams(), min_size=1, max_size=25), st.booleans())
def test_no_datagram_ends_protocol_or_spoils_output(
    received: list[tuple[Header, bytes, int]], in_hurry: bool
) -> None:
    mine = protocol()
    now_ns = 0
    for header, body, later_ns in received:
        now_ns += later_ns
        mine.published.boards[POSE].put(bytes(25), True, now_ns)
        try:
            beacon = codec.decode(body)
        except WireError:
            continue
        taken = mine.on_beacon(header, beacon, ("10.0.0.1", 1), now_ns)
        if taken is not None:
            if (t := taken.clock_sample) is not None:
                sample = (t.hw, t.boot_id, t.rx_ns, t.reverse_ns, t.forward_tx_ns, t.forward_ns)
                encode(TimingBatch((TimingSample("uav2", "main", *sample),)))
            for want, value in taken.values:
                encode_frame(
                    Frame(FrameKind.BOARD, want.data_id, value.origin_hw, stamp_ns=value.stamp_us * 1000)
                )
        if in_hurry or later_ns:
            mine.advance(now_ns)
            outgoing = mine.compose(now_ns)
            data = codec.encode(outgoing.beacon)
            codec.decode(data)
            codec.encode_header(Header(0, mine.identity.hw, outgoing.sequence, 0, 1))
            assert len(data) <= BODY_LIMIT
            mine.sent(outgoing.sequence, now_ns, len(data) + 38)
            assert 0 < mine.beacon_hz() <= 10.0


def test_foreign_session_numbers_cannot_exhaust_own() -> None:
    mine = Topology(1, 100, SECOND, 0)
    now_ns = 0
    for _ in range(20_000):
        now_ns += SECOND // 10
        mine.compose(now_ns, 1000)
        asked = mine.routing
        asked.on_requests(2, [SequenceRequest(1, (mine.next_sequence() + 0x7FFF) & 0xFFFF, 24)], now_ns)
    assert mine.next_sequence() > 100 + 4 * 0x7000, "a former session's numbers are passed quickly"
    assert mine.next_sequence() < 100 + 20_000 + 40 * 0x8000, "2000 s: four raises, then one a minute"


def test_node_near_end_of_numbers_is_not_raised() -> None:
    mine = Topology(1, 0xF800_0000, SECOND, 0)
    mine.compose(0, 1000)
    mine.routing.on_requests(2, [SequenceRequest(1, 0x7000, 24)], 0)
    assert mine.next_sequence() == 0xF800_0001
