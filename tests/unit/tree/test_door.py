"""The tree's public door: whatever can be decoded is taken or refused, and the tree goes on."""

import contextlib
import math
import time
import tracemalloc
import zlib

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.simulation.seeds import examples
from tests.unit.tree.pair import BATTERY, FAULTS, POSE, STEP, S, Tree, core, value

from swarmd.tree.core.action import RequestStructure, RequestSubscription, SendNotify
from swarmd.tree.core.structure import structure
from swarmd.tree.core.structure.index import Index, leaf
from swarmd.tree.core.structure.structure import PATHS_LIMIT, Patches, StructureEncoding
from swarmware.errors import InvalidInput, SwarmError, WireError
from swarmware.model import names
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.model.resource import Resource
from swarmware.types import registry
from swarmware.types.tree import Rule
from swarmware.types.tree_exchange import (
    StructureReply,
    StructureRequest,
    SubscribeReply,
    SubscribeRequest,
    TreeItem,
    TreeNotify,
)

NUMBERS = st.one_of(
    st.integers(0, 9),
    st.sampled_from([-1, 2**31, 2**32 - 1, 2**32, 2**63 - 1, 2**63, 2**64 - 1, -(2**63)]),
)
FLOATS = st.one_of(
    st.floats(),
    st.sampled_from([0.0, -0.0, 1e-320, 0.1, 60.0, 1e9, 1e18, 1e308, math.inf, -math.inf, math.nan]),
)
PLATFORMS = st.sampled_from(["gcs", "uav1", "uav7", "", "../x", "U", "a" * 300])
PATTERNS = st.one_of(
    st.sampled_from(["**", "*", "power/*", "health/faults", "nav/pose", "plan/*", "{a,b}/*", "*" * 30]),
    st.text(alphabet="ab*/{},_A", max_size=12),
)
RULES = st.builds(Rule, PATTERNS, FLOATS, FLOATS, FLOATS)
RESOURCES = st.sampled_from([BATTERY, FAULTS, POSE, STEP])
DATA = st.one_of(
    st.binary(max_size=20),
    st.builds(
        lambda put, removed: structure.encode([leaf(resource) for resource in put], list(removed)),
        st.lists(RESOURCES, max_size=3),
        st.lists(st.text(max_size=5), max_size=3),
    ),
)
ITEMS = st.builds(
    TreeItem,
    st.sampled_from(["power/battery", "health/faults", "nav/pose", "../../etc", "A", "x" * 500]),
    NUMBERS,
    NUMBERS,
    NUMBERS,
    NUMBERS,
    st.binary(max_size=9),
    NUMBERS,
)
MESSAGES = st.one_of(
    st.builds(
        SubscribeRequest,
        PLATFORMS,
        NUMBERS,
        NUMBERS,
        FLOATS,
        NUMBERS,
        st.booleans(),
        st.lists(PATTERNS, max_size=3).map(tuple),
        st.lists(RULES, max_size=3).map(tuple),
    ),
    st.builds(StructureRequest, PLATFORMS, NUMBERS, NUMBERS, NUMBERS, st.booleans()),
    st.builds(StructureReply, NUMBERS, NUMBERS, st.integers(-1, 5), NUMBERS, DATA),
    st.builds(SubscribeReply, NUMBERS, NUMBERS, st.booleans()),
    st.builds(
        TreeNotify,
        PLATFORMS,
        NUMBERS,
        NUMBERS,
        st.lists(ITEMS, max_size=3).map(tuple),
        NUMBERS,
        NUMBERS,
        DATA,
    ),
)
STEPS = st.one_of(
    MESSAGES,
    ITEMS,
    st.builds(lambda seconds: seconds, st.floats(0, 200)),
    st.builds(
        lambda path, hz, age: (path, hz, age), st.sampled_from(["nav/pose", "plan/step"]), FLOATS, FLOATS
    ),
)


def feed(tree: Tree, step: object, now_ns: int) -> None:
    """One thing from outside, as it comes: through the decoder, or not at all."""
    match step:
        case TreeItem():
            tree.on_values([msgspec.structs.replace(step, sequence=1, stamp_ns=1)], now_ns)
        case tuple():
            path, rate_hz, max_age_s = step
            with contextlib.suppress(ValueError):
                made = Resource(path=path, type="Pose", rate_hz=rate_hz, max_age_s=max_age_s, owner="x")
                tree.on_applications([made], ["/uav7/**"], now_ns)
        case msgspec.Struct():
            came = registry.decode(type(step), registry.encode(step))
            match came:
                case SubscribeRequest():
                    registry.encode(tree.on_subscribe_asked(came, None, now_ns))
                case StructureRequest():
                    registry.encode(tree.on_structure_asked(came, 0))
                case StructureReply():
                    tree.on_structure("uav7", came, now_ns)
                case SubscribeReply():
                    tree.on_subscribed("uav7", came, 0, now_ns)
                case TreeNotify():
                    tree.on_notify(came, now_ns)


def sendable(tree: Tree, now_ns: int) -> None:
    """What the tree wants sent fits the wire; half of the notifications arrive."""
    for action in tree.drain():
        match action:
            case RequestStructure(_, request) | RequestSubscription(_, request):
                registry.encode(request)
            case SendNotify(platform, notify):
                registry.decode(TreeNotify, registry.encode(notify))
                tree.on_notified(platform, notify, notify.serial % 2 == 0, now_ns)
    for offer in tree.subscribers.offers():
        registry.encode(offer)


@given(st.lists(STEPS, max_size=12))
@settings(deadline=None, max_examples=examples(40, 120))
def test_any_input_leaves_tree_with_sendable_output(steps: list[object]) -> None:
    tree, now_ns = core("uav1"), 0
    tree.on_up("uav7", 5, True, 0)
    for step in steps:
        if isinstance(step, float):
            now_ns += round(step * S)
            tree.on_timer(now_ns)
        else:
            with contextlib.suppress(SwarmError):
                feed(tree, step, now_ns)
        sendable(tree, now_ns)
    tree.on_applications([STEP], [], now_ns)
    tree.on_timer(now_ns + 100 * S)
    sendable(tree, now_ns)


@pytest.mark.parametrize("interval_s", [math.inf, -math.inf, math.nan, -1.0])
def test_a_subscription_that_is_refused_leaves_nothing_behind(interval_s: float) -> None:
    uav = core("uav1")
    for rule in (Rule("**", 0.0, interval_s), Rule("**", 0.0, 0.0, interval_s), Rule("**", interval_s)):
        with pytest.raises(InvalidInput, match=r"rule \*\*"):
            uav.on_subscribe_asked(SubscribeRequest("gcs", 1, 5, 60.0, 0, False, ("**",), (rule,)), None, 0)
        assert uav.subscribers.platforms() == []
    with pytest.raises(InvalidInput, match="lease_s"):
        uav.on_subscribe_asked(SubscribeRequest("gcs", 1, 5, interval_s, 0, False, ("**",)), None, 0)
    uav.on_applications([STEP], [], 0)
    uav.on_timer(S)
    assert uav.drain() == []


def test_refused_subscription_keeps_former_one() -> None:
    uav = core("uav1")
    uav.on_subscribe_asked(SubscribeRequest("gcs", 1, 5, 60.0, 0, False, ("power/battery",)), None, 0)
    with pytest.raises(InvalidInput):
        uav.on_subscribe_asked(SubscribeRequest("gcs", 1, 6, 60.0, 0, False, ("{",)), None, 0)
    uav.on_values([value("power/battery", 0.5)], 0)
    assert any(isinstance(action, SendNotify) for action in uav.drain())


@pytest.mark.parametrize("platform", ["", "../x", "Uav", "a/b"])
def test_what_is_no_platform_gets_no_place(platform: str) -> None:
    uav = core("uav1")
    with pytest.raises(InvalidInput):
        uav.on_subscribe_asked(SubscribeRequest(platform, 1, 5, 60.0, 0, False, ("**",)), None, 0)
    with pytest.raises(InvalidInput):
        uav.on_notify(TreeNotify(platform, 1, 1, (value("power/battery", 1.0),)), 0)
    assert uav.replicas.platforms() == []


@pytest.mark.parametrize(
    ("field", "number"), [("data_id", 2**32), ("data_id", -1), ("stamp_ns", 2**64 - 1), ("sequence", -1)]
)
def test_unfitting_header_number_is_refused_by_field(field: str, number: int) -> None:
    item = msgspec.structs.replace(value("power/battery", 1.0), **{field: number})
    with pytest.raises(WireError, match="TreeNotify"):
        registry.decode(TreeNotify, registry.encode(TreeNotify("uav1", 1, 1, (item,))))


@pytest.mark.parametrize("field", ["data_id", "sender_hw", "receiver_app", "stamp_ns", "hops_left"])
def test_unencodable_frame_names_its_number(field: str) -> None:
    frame = Frame(FrameKind.BOARD, 1)
    setattr(frame, field, 2**63)
    with pytest.raises(WireError, match=field):
        encode(frame)


def _bomb(paths: int) -> bytes:
    return zlib.compress(msgspec.msgpack.encode([[], [], [""] * paths]), 9)


def test_changes_are_small_with_or_without_dictionary() -> None:
    data = structure.encode([leaf(STEP)], [])
    plain = zlib.decompressobj(zdict=structure.DICTIONARY).decompress(data)
    assert structure.decode(zlib.compress(plain)) == structure.decode(data)
    assert len(data) < len(zlib.compress(plain, 9)) / 2
    with pytest.raises(WireError, match="structure"):
        structure.decode(zlib.compressobj(6, zdict=b"another").flush() + data)


def test_structure_of_two_million_paths_is_refused() -> None:
    bomb = _bomb(2_000_000)
    assert len(bomb) < 10_000
    tracemalloc.start()
    try:
        with pytest.raises(WireError):
            structure.decode(bomb)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 8 * 2**20


def test_structures_are_kept_by_size_not_number() -> None:
    patches = Patches(paths=100)
    for number in range(50):
        data = structure.encode([], [f"a{number}", *(f"b{index}" for index in range(30))])
        assert patches.decode(data) is patches.decode(data)
        assert patches.paths <= 100
    large = structure.encode([], [f"c{index}" for index in range(200)])
    assert len(patches.decode(large).removed) == 200
    assert patches.paths <= 100


def test_a_structure_grows_to_its_limit_only() -> None:
    gcs = core("gcs")
    gcs.on_up("uav1", 1, True, 0)
    gcs.drain()
    step = [leaf(Resource(path=f"a/r{index}", type="Float")) for index in range(PATHS_LIMIT)]
    gcs.on_structure(
        "uav1", StructureReply(1, 5, StructureEncoding.FULL, 0, structure.encode(step, [], step)), 0
    )
    replica = gcs.replicas.get("uav1")
    assert replica is not None
    assert replica.index is None
    with pytest.raises(WireError, match="at most"):
        structure.decode(structure.encode([leaf(STEP)], [])).apply(Index(step))


@pytest.mark.parametrize(
    "text", ["*" * 30 + "b", "*a" * 8 + "b", "**/a/" * 8 + "b", "{a,aa}" * 6 + "*b", "a*" * 8]
)
@pytest.mark.parametrize("path", ["a" * 190, "/".join("a" * 95)])
def test_look_at_path_takes_no_longer_whatever_pattern(text: str, path: str) -> None:
    pattern = names.Pattern(text)
    started = time.process_time()
    for _ in range(100):
        pattern.matches(path)
    # exponential or of high degree it would be hours; a millisecond each is a hundred times what it takes
    assert time.process_time() - started < 0.1 * 100


def test_too_many_wildcards_are_refused_by_their_number() -> None:
    with pytest.raises(InvalidInput, match="9 wildcards; expected at most 8"):
        names.Pattern("/".join("*" * 9))
    with pytest.raises(InvalidInput, match="too many"):
        names.Pattern("{a,b,c}" * 9)
    with pytest.raises(InvalidInput, match="characters"):
        names.Pattern("a" * 401)
