"""The decisions of a chassis driver: open orders, the set-point in force, and the fail-safe."""

from typing import Final

import msgspec

from swarmware.types.chassis import ChassisAction, ChassisOrder, ChassisReport
from swarmware.types.vehicle import Setpoint

REPEAT_NS: Final = 50_000_000
"""Period of repetition of an unanswered order; a kill, which must act within 100 ms, is sent twice by
then."""
SILENT_NS: Final = 3_000_000_000
"""Age of the newest report above which the chassis counts as lost, three periods of the reports."""
STOP: Final = Setpoint(0.0)
"""Set-point of the fail-safe, which stops a ground or surface vehicle and lets an air vehicle hover."""

_STOPS: Final = frozenset({ChassisAction.DISARM, ChassisAction.KILL})
_MOTORS: Final = _STOPS | {ChassisAction.ARM}


class DriveOutput(msgspec.Struct, frozen=True, gc=False):
    """A set-point for the device, with its stamp."""

    setpoint: Setpoint
    stamp_ns: int
    """Instant for which the set-point was computed."""


class ChassisCore:
    """Keeps orders to a chassis until they are answered, and guards its set-point with a watchdog.

    `watchdog_s`: age of the newest set-point above which an armed chassis gets the set-point of the
    fail-safe.
    """

    def __init__(self, watchdog_s: float) -> None:
        self._watchdog_ns = round(watchdog_s * 1e9)
        self._orders: dict[int, tuple[ChassisOrder, int]] = {}
        """Open orders by number, each with the instant of its next repetition."""
        self._last_number = 0
        self._drive: DriveOutput | None = None
        self._forwarded: DriveOutput | None = None
        self._report: ChassisReport | None = None
        self._reported_ns = 0
        """Instant of the newest report, or of the opening before the first report."""

    @property
    def report(self) -> ChassisReport | None:
        """The newest report of the chassis since it was opened."""
        return self._report

    def on_opened(self, now_ns: int) -> None:
        """Takes that the device was opened, when its state is unknown and no order is open."""
        self._reported_ns = now_ns
        self._report = self._drive = self._forwarded = None
        self._orders.clear()

    def on_setpoint(self, setpoint: Setpoint, stamp_ns: int) -> None:
        """Takes a set-point, with the instant for which it was computed."""
        self._drive = DriveOutput(setpoint, stamp_ns)

    def on_order(
        self, action: ChassisAction, now_ns: int, gains: dict[str, float] | None = None
    ) -> ChassisOrder:
        """Creates an order, to be sent now; an order to the motors replaces an open order to the motors."""
        # from the clock, so that the numbers keep growing when the driver starts again
        self._last_number = max(now_ns, self._last_number + 1)
        order = ChassisOrder(self._last_number, action, gains or {})
        if action in _MOTORS:
            # otherwise a repeated old order could undo the new one
            for number in [n for n, (former, _) in self._orders.items() if former.action in _MOTORS]:
                del self._orders[number]
        self._orders[order.number] = (order, now_ns + REPEAT_NS)
        return order

    def on_report(self, report: ChassisReport, stamp_ns: int) -> None:
        """Takes a report with its instant; the report closes the answered order and all earlier orders.

        A report from long before the opening is ignored, because its device may have ended.
        """
        # shared memory may still hold a report of the previous run
        if stamp_ns < self._reported_ns - SILENT_NS:
            return
        self._report, self._reported_ns = report, stamp_ns
        for number in [number for number in self._orders if number <= report.answered]:
            del self._orders[number]  # the chassis does not execute orders with smaller numbers any more

    def answer(self, order: ChassisOrder) -> ChassisReport | None:
        """The report that answers an order, or None while there is no answer.

        An order that the chassis skipped for a later order counts as refused, unless the order was to stop
        the motors and they are stopped.
        """
        report = self._report
        if report is None or report.answered < order.number:
            return None
        if report.answered == order.number or (order.action in _STOPS and not report.armed):
            return report
        return msgspec.structs.replace(report, refused=f"{order.action}: a later order replaced it")

    @property
    def killing(self) -> bool:
        """True while a kill is not answered, when no other order may be sent."""
        return any(order.action is ChassisAction.KILL for order, _ in self._orders.values())

    @property
    def idle(self) -> bool:
        """True if all orders are answered."""
        return not self._orders

    def has_open(self, order: ChassisOrder) -> bool:
        """True if an order was neither answered nor closed."""
        return order.number in self._orders

    def forget(self, order: ChassisOrder) -> None:
        """Closes an order whose requester no longer waits."""
        self._orders.pop(order.number, None)

    def repeated(self, now_ns: int) -> list[ChassisOrder]:
        """Returns the open orders whose repetition is due."""
        due = [order for order, due_ns in self._orders.values() if now_ns >= due_ns]
        for order in due:
            self._orders[order.number] = (order, now_ns + REPEAT_NS)
        return due

    def silent(self, now_ns: int) -> bool:
        """True if the chassis has not reported for too long."""
        return now_ns - self._reported_ns > SILENT_NS

    def failsafe(self, now_ns: int) -> bool:
        """True if the chassis is armed and has no fresh set-point."""
        if self._report is None or not self._report.armed:
            return False
        return self._drive is None or now_ns - self._drive.stamp_ns > self._watchdog_ns

    def output(self, now_ns: int) -> DriveOutput | None:
        """The set-point to send to the device, or None if the device has the newest."""
        if self.failsafe(now_ns):
            self._forwarded = None
            return DriveOutput(STOP, now_ns)
        # the device keeps its set-point, so each is sent once
        if self._drive is self._forwarded:
            return None
        self._forwarded = self._drive
        return self._drive
