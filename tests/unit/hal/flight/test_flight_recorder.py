"""Records of a flight: their rows, and the instant at which a record is complete."""

from itertools import pairwise

from swarmd.hal.core.flight.flight_recorder import AFTER_NS, PERIOD_NS, SPAN_NS, FlightRecorder
from swarmware.types.flight_record import FlightRecord, FlightRecordRow

MS = 1_000_000


def row(ms: int) -> FlightRecordRow:
    return FlightRecordRow(ms * MS, 0.01, 0.1, 0.0, 5.0, 0.0, (0.6,) * 4)


def flown(recorder: FlightRecorder, first_ms: int, last_ms: int) -> None:
    for ms in range(first_ms, last_ms, 10):
        recorder.on_step(row(ms))


def test_fault_is_recorded_with_surrounding_seconds() -> None:
    recorder = FlightRecorder()
    flown(recorder, 0, 10_000)
    recorder.on_fault("flight/loop away", 10_000 * MS)
    flown(recorder, 10_600, 12_000)
    assert recorder.take(10_000 * MS + AFTER_NS - 1) is None
    record = recorder.take(10_000 * MS + AFTER_NS)
    assert record is not None
    assert record.reason == "flight/loop away"
    stamps = [one.stamp_ns for one in record.rows]
    assert stamps[-1] - stamps[0] <= SPAN_NS
    assert stamps[0] < 7_100 * MS
    steps = {later - earlier for earlier, later in pairwise(stamps)}
    assert min(steps) == PERIOD_NS
    assert max(steps) >= 600 * MS, "the gap is seen"
    assert recorder.take(20_000 * MS) is None


def test_faults_that_follow_are_in_the_same_record() -> None:
    recorder = FlightRecorder()
    flown(recorder, 0, 1_000)
    recorder.on_fault("flight/loop away", 1_000 * MS)
    recorder.on_fault("flight/tilt beyond", 1_500 * MS)
    assert recorder.take(2_999 * MS) is None
    record = recorder.take(3_000 * MS)
    assert isinstance(record, FlightRecord)
    assert record.reason == "flight/loop away, flight/tilt beyond"
    recorder.on_fault("flight/contact touched", 4_000 * MS)
    again = recorder.take(6_000 * MS)
    assert again is not None
    assert again.reason == "flight/contact touched"
