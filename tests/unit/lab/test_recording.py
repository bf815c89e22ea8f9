"""The nodes' logs on one time axis."""

from pathlib import Path

import pytest

from swarmlab.measure.clocks import ClockTruth
from swarmlab.measure.recording import TRUTH, Recording
from swarmware.model.clock import Clock
from swarmware.recorder.segment import LogChannel, SegmentWriter
from swarmware.types import registry
from swarmware.types.vehicle import Pose

ORIGIN_NS = 5_000_000_000_000
FAST = ClockTruth(-3.5, 42.0)


def write(folder: Path, platform: str, clock: Clock, sequences: list[int]) -> None:
    """A pose a tenth of a second apart, x in metres = true seconds since the origin."""
    folder.mkdir()
    writer = SegmentWriter(folder / "000001.mcap", {})
    truth = LogChannel(platform, TRUTH, "board", "Pose", f"{platform}:sim:out")
    other = LogChannel("other", TRUTH, "board", "Pose", f"{platform}:sim:out")
    for number in sequences:
        t_s = number / 10
        stamp = clock.from_mono_ns(ORIGIN_NS + round(t_s * 1e9))
        writer.append(truth, number, stamp, 1, registry.encode(Pose(t_s, 2.0, 3.0)))
    writer.append(other, sequences[-1] + 1, 0, 2, registry.encode(Pose(99, 99, 99)))
    writer.append(truth, sequences[-1] + 2, 0, 3, b"\xc1")
    writer.close()


def test_stamps_of_a_wrong_clock_become_true_time(tmp_path: Path) -> None:
    write(tmp_path / "a", "a", FAST.clock, [1, 2, 3])
    recording = Recording({"a": tmp_path / "a"}, {"a": FAST}, ORIGIN_NS, [TRUTH])
    values = recording.values("a", TRUTH, Pose)
    assert [t_s for t_s, _ in values] == pytest.approx([0.1, 0.2, 0.3], abs=1e-8)
    assert [pose.x_m for _, pose in values] == [0.1, 0.2, 0.3]


def test_entries_are_counted_and_so_are_holes(tmp_path: Path) -> None:
    write(tmp_path / "a", "a", FAST.clock, [1, 2, 5])
    recording = Recording({"a": tmp_path / "a"}, {"a": FAST}, ORIGIN_NS, [TRUTH])
    assert (recording.entries, recording.missing) == (5, 2)


def test_a_path_nobody_wants_is_not_kept(tmp_path: Path) -> None:
    write(tmp_path / "a", "a", FAST.clock, [1])
    recording = Recording({"a": tmp_path / "a"}, {"a": FAST}, ORIGIN_NS, ["nav/goal"])
    assert recording.values("a", TRUTH, Pose) == []
    assert recording.entries == 3


def test_a_track_is_made_of_the_truth(tmp_path: Path) -> None:
    write(tmp_path / "a", "a", FAST.clock, [1, 2, 3, 4])
    recording = Recording({"a": tmp_path / "a"}, {"a": FAST}, ORIGIN_NS, [TRUTH])
    track = recording.track("a")
    assert track.xyz_m[:, 0] == pytest.approx(track.t_s, abs=1e-7)
    assert track.xyz_m.shape == (4, 3)


def test_a_node_without_a_body_was_nowhere(tmp_path: Path) -> None:
    write(tmp_path / "a", "a", FAST.clock, [1])
    recording = Recording({"a": tmp_path / "a"}, {"a": FAST}, ORIGIN_NS, [])
    assert recording.track("a").xyz_m.shape == (0, 3)
