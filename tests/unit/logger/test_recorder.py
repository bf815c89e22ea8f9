"""The recorder of a node: frames from shared memory are on disk, in the queue of their module."""

from pathlib import Path

from swarmd.logger.config import Config
from swarmd.logger.core.sampling_plan import logged_resource
from swarmd.logger.recorder import Batch, Recorder
from swarmware.model.frame import Codec, Frame, FrameKind
from swarmware.model.resource import Kind as ResourceKind
from swarmware.model.resource import Resource
from swarmware.recorder.query import FolderSource, Query
from swarmware.types import registry
from swarmware.types.log import GapCause, LogGap
from swarmware.types.scalar import Int

FRAME = Frame(FrameKind.EVENT, 7, stamp_ns=5, payload=registry.encode(Int(3)))


def test_entry_is_queued_by_writer_or_taker(
    tmp_path: Path,
) -> None:
    book = Recorder(tmp_path, "uav1", Config())
    batch = Batch()
    assert not batch
    for kind, sender in ((ResourceKind.EVENT, ""), (ResourceKind.COMMAND, "operator#1@gcs")):
        made = logged_resource(
            Resource(path=f"test/{kind}", kind=kind, type="Int", log="all", owner="planner")
        )
        assert made is not None
        batch.frames.append((made, FRAME, 9, sender))
    batch.gaps.append((LogGap(GapCause.RING, "uav1:planner:out", "test/event", 4), 6, 10))
    assert batch
    book.write(batch)
    book.close()
    entries = list(FolderSource([tmp_path]).entries(Query()))
    assert sorted((one.queue, one.path, one.sender, one.stamp_ns, one.utc_ns) for one in entries) == [
        ("uav1:logger:out", "log/gaps", "", 6, 10),
        ("uav1:planner:in", "test/command", "operator#1@gcs", 5, 9),
        ("uav1:planner:out", "test/event", "", 5, 9),
    ]
    assert (book.totals.frames, book.totals.missing) == (2, 4)


def test_unreadable_payload_is_kept_unchanged(tmp_path: Path) -> None:
    book = Recorder(tmp_path, "uav1", Config())
    made = logged_resource(
        Resource(path="test/event", kind=ResourceKind.EVENT, type="Int", log="all", owner="planner")
    )
    assert made is not None
    batch = Batch()
    batch.frames.append((made, Frame(FrameKind.EVENT, 7, codec=Codec.ZLIB, payload=b"no zlib"), 9, ""))
    book.write(batch)
    book.close()
    (entry,) = FolderSource([tmp_path]).entries(Query())
    assert entry.payload == b"no zlib"
