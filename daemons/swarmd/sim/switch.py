"""The safety pilot's switch of a simulated vehicle, set by request."""

from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.types.control import SafetySwitch, SwitchRequest
from swarmware.types.vehicle import VehicleMode


class Switch:
    """Publishes the position of the switch: at first auto, after a restart the former one."""

    def __init__(self, module: Module) -> None:
        self._module = module
        former = module.reader("vehicle/switch", SafetySwitch)
        self._former = former.value or SafetySwitch(VehicleMode.AUTO)
        former.close()
        self._board = module.writer(
            "vehicle/switch", SafetySwitch, description="Position of the safety pilot's switch"
        )

    def serve(self) -> None:
        """Publish the position, and register the handler that changes it."""
        self._board.write(self._former)
        self._module.serve(
            "sys/sim/switch",
            SwitchRequest,
            self._set,
            reply=SafetySwitch,
            description="Set the safety pilot's switch",
        )

    def _set(self, request: SwitchRequest, meta: Meta) -> SafetySwitch:
        position = SafetySwitch(request.mode)
        self._board.write(position)
        self._module.log.info("switch at %s", position.mode)
        return position
