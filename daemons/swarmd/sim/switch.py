"""The safety pilot's switch of a simulated vehicle, set by request."""

from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.writer import BoardWriter
from swarmware.types.control import SafetySwitch, SwitchRequest
from swarmware.types.vehicle import VehicleMode


class Switch:
    """The position of the switch, which starts at auto and survives a restart.

    `published`: True to publish the position here, False if a driver reads it from the simulated transmitter.
    """

    def __init__(self, module: Module, *, published: bool) -> None:
        self._module = module
        # the board outlives its writer, as a real switch keeps its position
        former = module.reader("vehicle/switch", SafetySwitch)
        self._position = former.value or SafetySwitch(VehicleMode.AUTO)
        former.close()
        self._board: BoardWriter[SafetySwitch] | None = None
        if published:
            self._board = module.writer(
                "vehicle/switch", SafetySwitch, description="Position of the safety pilot's switch"
            )

    @property
    def mode(self) -> VehicleMode:
        """The present position of the switch."""
        return self._position.mode

    def serve(self) -> None:
        """Publishes the position, and registers the request that changes it."""
        self._publish()
        self._module.serve(
            "sys/sim/switch",
            SwitchRequest,
            self._set,
            reply=SafetySwitch,
            description="Set the safety pilot's switch",
        )

    def _set(self, request: SwitchRequest, meta: Meta) -> SafetySwitch:
        self._position = SafetySwitch(request.mode)
        self._publish()
        self._module.log.info("switch at %s", request.mode)
        return self._position

    def _publish(self) -> None:
        if self._board is not None:
            self._board.write(self._position)
