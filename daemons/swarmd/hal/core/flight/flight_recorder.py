"""Recorder of the last seconds of a flight, which a fault writes to the log."""

from collections import deque
from typing import Final

from swarmware.types.flight_record import FlightRecord, FlightRecordRow

PERIOD_NS: Final = 50_000_000
"""Minimum time between two rows; 20 Hz resolve all motions of a vehicle of this size."""
SPAN_NS: Final = 5_000_000_000
"""Duration of a record, before and after a fault."""
AFTER_NS: Final = 2_000_000_000
"""Time after a fault that the record includes, to show whether the vehicle recovers."""


class FlightRecorder:
    """Keeps rows of the control loop, and makes a record of the seconds before and after a fault."""

    def __init__(self) -> None:
        self._rows: deque[FlightRecordRow] = deque()
        self._reasons: list[str] = []
        """Faults of the record that is being made."""
        self._due_ns: int | None = None

    def on_step(self, row: FlightRecordRow) -> None:
        """Takes a control step in flight."""
        if self._rows and row.stamp_ns - self._rows[-1].stamp_ns < PERIOD_NS:
            return
        self._rows.append(row)
        while row.stamp_ns - self._rows[0].stamp_ns > SPAN_NS:
            self._rows.popleft()

    def on_fault(self, reason: str, now_ns: int) -> None:
        """Takes a fault; further faults before the record is complete belong to the same record."""
        self._reasons.append(reason)
        if self._due_ns is None:
            # the record waits for the seconds after the fault, which show its effect
            self._due_ns = now_ns + AFTER_NS

    def take(self, now_ns: int) -> FlightRecord | None:
        """The record of a fault once it is complete, else None."""
        if self._due_ns is None or now_ns < self._due_ns:
            return None
        record = FlightRecord(", ".join(self._reasons), tuple(self._rows))
        self._due_ns = None
        self._reasons = []
        return record
