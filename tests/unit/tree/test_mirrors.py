"""Mirrors in shared memory, written from what other platforms notify."""

import asyncio
from pathlib import Path

import msgspec
import pytest
from tests.unit.tree.pair import value

from swarmd.tree.boundary import Boundary
from swarmd.tree.mirrors import Mirrors
from swarmware.errors import WireError
from swarmware.model.frame import FrameKind
from swarmware.testing.tmpnode import tmp_node
from swarmware.transport.shm.layout import ring_file


@pytest.mark.parametrize(
    "change",
    [{"data_id": 2**40}, {"stamp_ns": 2**64 - 1}, {"kind": FrameKind.ACK}, {"kind": 77}, {"codec": 5}],
)
def test_an_item_that_fits_no_frame_is_refused_and_makes_no_ring(
    tmp_path: Path, change: dict[str, int]
) -> None:
    async def run() -> None:
        async with tmp_node(tmp_path) as node:
            mirrors = Mirrors(node)
            with pytest.raises(WireError):
                mirrors.write("uav7", msgspec.structs.replace(value("power/battery", 1.0), **change))
            assert not ring_file(node.shm_dir, "power/battery", "uav7").exists()
            assert mirrors.write("uav7", value("power/battery", 1.0))
            mirrors.close()

    asyncio.run(run())


def test_mirrors_of_what_has_gone_are_removed_also_those_of_a_former_start(tmp_path: Path) -> None:
    async def run() -> None:
        async with tmp_node(tmp_path) as node:
            former = Mirrors(node)
            for path in ("power/battery", "plan/a", "plan/b"):
                former.write("uav7", value(path, 1.0))
            former.close()
            mirrors = Mirrors(node)
            assert mirrors.platforms() == ["uav7"]
            mirrors.write("uav7", value("plan/c", 1.0))
            of_broker = node.mirror_writer("uav7", "nav/pose")
            mirrors.keep_only("uav7", {"power/battery"})
            kept = sorted(ring.name for ring in (node.shm_dir / "uav7").glob("*.ring"))
            assert kept == ["nav.pose.ring", "power.battery.ring"], "the broker's own is still written"
            of_broker.close(unlink=False)
            mirrors.forget("uav7")
            assert list((node.shm_dir / "uav7").glob("*.ring")) == []
            mirrors.close()

    asyncio.run(run())


def test_what_fails_at_the_boundary_is_counted_by_name_and_told_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    boundary = Boundary()
    for _ in range(3):
        for what, error in (
            ("value of nav/pose", ZeroDivisionError()),
            ("notification of uav3", WireError("too short")),
        ):
            with boundary(what):
                raise error
    assert boundary.refused == 6
    assert boundary.counts == {"value of nav/pose": 3, "notification of uav3": 3}
    told = [record.getMessage() for record in caplog.records]
    assert told == [
        "value of nav/pose: failed, left out: ZeroDivisionError()",
        "notification of uav3: refused: too short",
    ]


def test_an_end_passes_the_boundary() -> None:
    with pytest.raises(asyncio.CancelledError), Boundary()("anything"):
        raise asyncio.CancelledError
