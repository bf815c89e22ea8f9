"""Set-points of servos and motors, read from boards and guarded by watchdogs."""

from collections.abc import Sequence
from typing import Protocol

from swarmd.hal.core.actuator_output import ActuatorOutput
from swarmware.module.board import BoardReader
from swarmware.module.module import Module
from swarmware.types.scalar import Float
from swarmware.types.vehicle import VehicleState


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
