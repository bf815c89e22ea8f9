"""Codec for the CAN frames of VESC motor controllers, commands and states."""

import struct
from typing import TYPE_CHECKING, Final

from swarmware.errors import WireError
from swarmware.types.vehicle import MotorControllerState

if TYPE_CHECKING:
    from swarmd.hal.config import VescQuantity

_COMMANDS: Final[dict["VescQuantity", tuple[int, float]]] = {
    "duty": (0, 100_000.0),
    "current": (1, 1000.0),
    "speed": (3, 1.0),
}
"""Command number by quantity, and steps per unit: ratio, A, electrical revolutions per minute."""
_STATUS_FORM: Final = struct.Struct(">ihh")
_STATUS_4_FORM: Final = struct.Struct(">hhhh")
_STATUS_5_FORM: Final = struct.Struct(">ih")


def command(controller: int, quantity: "VescQuantity", value: float) -> tuple[int, bytes]:
    """Identifier and data of a command. Source: VESC firmware documentation, page on CAN."""
    number, steps = _COMMANDS[quantity]
    # the frame has 32 bits, and a wrapped value would reverse the motor
    steps_clipped = max(-(2**31), min(2**31 - 1, round(value * steps)))
    return number << 8 | controller, struct.pack(">i", steps_clipped)


class VescState:
    """Collects the state of one controller from its frames."""

    def __init__(self, controller: int) -> None:
        self._controller = controller
        self._voltage_v: float | None = None
        self._temperature_degc: float | None = None

    def on_frame(self, identifier: int, data: bytes) -> MotorControllerState | None:
        """Takes a frame of the bus; returns the state at each first status frame of this controller, else
        None.

        Raises: WireError for a status frame that is too short.
        """
        kind, controller = identifier >> 8, identifier & 0xFF
        if controller != self._controller:
            return None
        try:
            match kind:
                case 9:  # status: speed, current of the motor, duty
                    speed, current, duty = _STATUS_FORM.unpack_from(data)
                    return MotorControllerState(
                        float(speed), current / 10, duty / 1000, self._voltage_v, self._temperature_degc
                    )
                case 16:  # status 4: temperatures of electronics and motor, current of the battery
                    self._temperature_degc = _STATUS_4_FORM.unpack_from(data)[0] / 10
                case 27:  # status 5: turns, voltage of the battery
                    self._voltage_v = _STATUS_5_FORM.unpack_from(data)[1] / 10
        except struct.error:
            raise WireError(f"status {kind} of {len(data)} bytes") from None
        return None
