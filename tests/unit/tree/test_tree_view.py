"""What a node knows of resources without asking: values of rings and mirrors, their ages and qualities."""

import asyncio
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from tests.unit.tree.pair import POSE, Pair, S, core

from swarmd.tree.core.structure.index import leaf
from swarmd.tree.core.tree import SwarmTree
from swarmd.tree.exchange.taps import Peek
from swarmd.tree.operator.tree_view import TreeView
from swarmware.errors import NotFound
from swarmware.model.frame import Frame, FrameKind, encode
from swarmware.model.names import Pattern, hardware_id
from swarmware.model.resource import Kind, Resource
from swarmware.node.mirror_writer import MirrorWriter
from swarmware.node.node import Node
from swarmware.testing.tmpnode import tmp_node
from swarmware.types import registry
from swarmware.types.channel import ChannelLimit, ChannelSettings
from swarmware.types.vehicle import Pose

GOTO = Resource(path="cmd/goto", kind=Kind.COMMAND, type="Goal", owner="navigator")


def pose(platform: str, stamp_ns: int) -> Frame:
    payload = registry.encode(Pose(1.0, 2.0))
    return Frame(
        FrameKind.BOARD,
        POSE.data_id,
        hardware_id(platform),
        0,
        sequence=7,
        stamp_ns=stamp_ns,
        payload=payload,
    )


class Seen:
    """gcs subscribes to the pose of uav1 and mirrors it; both have the same clock, or none is known."""

    def __init__(self, node: Node, *, clock_known: bool = True) -> None:
        self.both = Pair(core("gcs"), core("uav1"))
        self.both.trees["gcs"].on_applications([GOTO], ["/uav1/nav/pose"], 0)
        self.both.meet()
        self.both.carry()
        self.now_ns = 0
        self._mirrors = MirrorWriter(node)
        self._peek = Peek(node.shm_dir)
        self.node = node
        tree: SwarmTree = self.both.trees["gcs"].core
        self.view = TreeView(
            tree,
            self._peek,
            lambda: self.now_ns,
            lambda _, stamp_ns: stamp_ns if clock_known else None,
        )

    def mirror(self, stamp_ns: int) -> None:
        self._mirrors.write("uav1", "nav/pose", pose("uav1", stamp_ns))

    def mirror_frame(self, frame: Frame) -> None:
        self._mirrors.write("uav1", "nav/pose", frame, epoch=1)

    def limit(self, *limits: ChannelLimit) -> None:
        self.both.trees["uav1"].on_limits(limits, self.both.now_ns)
        self.both.wait(1)

    def qualities(self) -> tuple[str, str]:
        """Of the mirrored value, and of its entry in a list."""
        found = self.view.mirrored_value("uav1", "nav/pose")
        assert found is not None
        return found.quality, self.view.entry("uav1", leaf(POSE)).quality

    def close(self) -> None:
        self._mirrors.close()
        self._peek.close()


def seen(tmp_path: Path, test: Callable[[Seen], None], *, clock_known: bool = True) -> None:
    async def run() -> None:
        async with tmp_node(tmp_path, "gcs") as node:
            given = Seen(node, clock_known=clock_known)
            test(given)
            given.close()

    asyncio.run(run())


def test_limited_board_is_live_for_three_intervals(tmp_path: Path) -> None:
    def test(given: Seen) -> None:
        given.mirror(0)
        for age_s, expected in ((1.2, "live"), (1.3, "stale")):
            given.now_ns = round(age_s * S)
            assert given.qualities() == (expected, expected)
        given.limit(ChannelLimit("nav/*", ChannelSettings(0.5)))
        for age_s, expected in ((5.9, "live"), (6.1, "stale")):
            given.now_ns = round(age_s * S)
            assert given.qualities() == (expected, expected)
        given.now_ns = 2 * S
        assert given.qualities() == ("live", "live")
        given.limit()
        assert given.qualities() == ("stale", "stale")
        given.limit(ChannelLimit("**", ChannelSettings(0.0)))
        assert given.qualities() == ("stale", "stale"), "an operator forbade it: nothing new comes"

    seen(tmp_path, test)


def test_lost_platforms_value_is_aged_by_loss(
    tmp_path: Path,
) -> None:
    def test(given: Seen) -> None:
        given.mirror(5)
        found = given.view.mirrored_value("uav1", "nav/pose")
        assert found is not None
        assert (found.age_s, found.quality, found.source) == (None, "stale", "mirror")
        given.both.trees["gcs"].on_gone("uav1", 3 * S)
        given.now_ns = 10 * S
        found = given.view.mirrored_value("uav1", "nav/pose")
        assert found is not None
        assert (found.age_s, found.quality) == (7.0, "lost")
        assert not given.view.platform("uav1").reachable

    seen(tmp_path, test, clock_known=False)


def test_mirror_of_former_subscription_is_no_value(tmp_path: Path) -> None:
    def test(given: Seen) -> None:
        given.mirror(0)
        given.both.trees["gcs"].on_applications([], [], 0)
        given.both.carry()
        assert given.view.mirrored_value("uav1", "nav/pose") is None
        assert given.view.mirrored_value("uav1", "nav/speed") is None
        assert given.view.mirrored_value("uav9", "nav/pose") is None

    seen(tmp_path, test)


def test_own_value_has_age_version_and_text(tmp_path: Path) -> None:
    def test(given: Seen) -> None:
        ring = given.node.publication("nav/pose", slots=4, slot_bytes=256)
        ring.publish(encode(pose("gcs", 5 * S)))
        given.now_ns = 6 * S
        found = given.view.own_value(given.view.own_leaf("nav/pose"), None)
        assert (found.path, found.age_s, found.version, found.quality) == ("/gcs/nav/pose", 1.0, 7, "stale")
        assert msgspec.msgpack.decode(found.data, type=Pose) == Pose(1.0, 2.0)
        assert given.view.own_value(given.view.own_leaf("nav/pose"), 3).version == 3
        assert given.view.own_text(POSE).startswith("[1.0,2.0")
        ring.close()

    seen(tmp_path, test)


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("nav/pos", "/gcs/nav/pos: no such resource; did you mean /gcs/nav/pose"),
        ("nav/pose", "/gcs/nav/pose: no value yet; expected one from navigator"),
        ("cmd/goto", "/gcs/cmd/goto: a command has no value; expected a board, event, stream or setting"),
    ],
)
def test_valueless_resource_is_refused_with_reason(tmp_path: Path, path: str, expected: str) -> None:
    def test(given: Seen) -> None:
        with pytest.raises(NotFound, match=expected):
            given.view.own_value(given.view.own_leaf(path), None)
        assert given.view.own_text(GOTO) == ""

    seen(tmp_path, test)


def test_resources_are_listed_over_platforms_in_order(tmp_path: Path) -> None:
    def test(given: Seen) -> None:
        def paths(after: str = "") -> list[str]:
            found = given.view.matching(Pattern("*"), "{nav,power}/*", after)
            return [f"/{platform}/{item.resource.path}" for platform, items in found for item in items]

        everything = ["/gcs/nav/pose", "/gcs/power/battery", "/uav1/nav/pose", "/uav1/power/battery"]
        assert paths() == everything
        assert [paths(after) for after in everything] == [everything[1:], everything[2:], everything[3:], []]
        assert given.view.platforms() == ["gcs", "uav1"]
        assert given.view.platform("uav1").resources == 3
        with pytest.raises(NotFound, match="platform 'uav9': not known to gcs; expected one of gcs, uav1"):
            given.view.check_platform("uav9")

    seen(tmp_path, test)


def test_rate_comes_from_owners_numbers_only(tmp_path: Path) -> None:
    def test(given: Seen) -> None:
        for number in range(6):
            frame = pose("uav1", number * S // 5)
            frame.sequence = 2 * number + 1
            given.mirror_frame(frame)
        given.now_ns = S
        notified = leaf(msgspec.structs.replace(POSE, link="notify"))
        assert given.view.entry("uav1", notified).measured_hz == pytest.approx(10.0)
        assert given.view.entry("uav1", leaf(POSE)).measured_hz is None, "the beacon carries no numbers"

    seen(tmp_path, test)


def test_path_without_first_slash_is_corrected(tmp_path: Path) -> None:
    def test(given: Seen) -> None:
        with pytest.raises(NotFound, match=r"did you mean /uav1/nav/pose\?"):
            given.view.own_leaf("uav1/nav/pose")

    seen(tmp_path, test)
