"""Set-points of servos and motors, read from boards and guarded by watchdogs."""

import math
from collections.abc import Sequence
from typing import Protocol

from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.types.scalar import Float
from swarmware.types.vehicle import VehicleState


class ActuatorOutput:
    """Applies the newest set-point of an output while it is fresh and, if required, the vehicle is armed.

    `watchdog_s`: age of the set-point above which the output goes to its safe state.
    """

    def __init__(self, path: str, watchdog_s: float, *, needs_arming: bool) -> None:
        self._path = path
        self._watchdog_ns = round(watchdog_s * 1e9)
        self._needs_arming = needs_arming
        self._value = 0.0
        self._stamp_ns: int | None = None

    def on_value(self, value: Float, stamp_ns: int) -> None:
        """Takes a set-point with its instant; infinite values and NaN are ignored."""
        # NaN would pass the limits below, since its comparisons are false
        if math.isfinite(value.value):
            self._value, self._stamp_ns = min(max(value.value, -1.0), 1.0), stamp_ns

    def value(self, now_ns: int, *, armed: bool) -> float | None:
        """The set-point from -1 to 1, or None for the safe state."""
        if self._stamp_ns is None or self._is_old(now_ns) or (self._needs_arming and not armed):
            return None
        return self._value

    def failsafe(self, now_ns: int, *, armed: bool) -> str:
        """Reason of a fail-safe after set-points have stopped, or "" without a fail-safe."""
        # an output that never had a set-point is at rest, which is not a fault
        if self._stamp_ns is None or not self._is_old(now_ns) or (self._needs_arming and not armed):
            return ""
        return f"no set-point in {self._path} for more than {self._watchdog_ns / 1e9:g} s"

    def _is_old(self, now_ns: int) -> bool:
        return self._stamp_ns is not None and now_ns - self._stamp_ns > self._watchdog_ns


class OutputSettings(Protocol):
    """The settings of an output that its board needs."""

    @property
    def path(self) -> str: ...
    @property
    def needs_arming(self) -> bool: ...


class OutputBoards:
    """Reads the boards of several outputs, and the arming state of the vehicle."""

    def __init__(self, module: Module, settings: Sequence[OutputSettings], watchdog_s: float) -> None:
        self._module = module
        self._readers = [module.reader(one.path, Float) for one in settings]
        self._outputs = [
            ActuatorOutput(one.path, watchdog_s, needs_arming=one.needs_arming) for one in settings
        ]
        self._vehicle: BoardReader[VehicleState] | None = None
        # the state of the vehicle is read only if an output depends on it
        if any(one.needs_arming for one in settings):
            self._vehicle = module.reader("vehicle/state", VehicleState)

    @property
    def _armed(self) -> bool:
        state = None if self._vehicle is None else self._vehicle.value
        return state is not None and state.armed

    def values(self, now_ns: int) -> list[float | None]:
        """Value of each output from -1 to 1, or None for its safe state."""
        for reader, output in zip(self._readers, self._outputs, strict=True):
            value, age_s = reader.value, reader.age_s
            if value is not None and age_s is not None:
                output.on_value(value, now_ns - round(age_s * 1e9))
        return [output.value(now_ns, armed=self._armed) for output in self._outputs]

    def failsafe(self, now_ns: int) -> str:
        """Reason of the first output whose set-points have stopped, or "" without a fail-safe."""
        reasons = (output.failsafe(now_ns, armed=self._armed) for output in self._outputs)
        return next((reason for reason in reasons if reason), "")

    def close(self) -> None:
        """Closes the readers of all boards."""
        for reader in self._readers:
            reader.close()
        if self._vehicle is not None:
            self._vehicle.close()
