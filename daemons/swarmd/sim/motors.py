"""Requests to arm, disarm and kill the motors, served by the vehicle."""

import logging
from collections.abc import Callable, Iterable

import msgspec

from swarmd.sim.core.simulation import VehicleModel
from swarmd.sim.core.vehicle_core import Action, VehicleCore
from swarmware.errors import Denied
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.requester import requester
from swarmware.module.writer import BoardWriter
from swarmware.types.vehicle import ArmRequest, KillRequest, MotorAction, MotorOrder, VehicleState

OrderMotors = Callable[[], tuple[VehicleState, list[Action]]]


class Motors:
    """Serves requests to the motors, independent of mission and navigator, with an audit log."""

    def __init__(
        self,
        module: Module,
        core: VehicleCore,
        feed: Callable[[Iterable[Action]], None],
        vehicle: VehicleModel,
        orders: BoardWriter[MotorOrder],
    ) -> None:
        self._module = module
        self._core = core
        self._feed = feed
        self._vehicle = vehicle
        self._orders = orders

    def serve(self) -> None:
        """Register the handlers of the vehicle's requests."""
        serve = self._module.serve
        serve(
            "sys/vehicle/arm",
            ArmRequest,
            self._arm,
            reply=VehicleState,
            description="Arm or disarm the motors",
        )
        serve(
            "sys/vehicle/kill",
            KillRequest,
            self._kill,
            reply=VehicleState,
            description="Stop the motors, also in the air",
        )

    def _arm(self, request: ArmRequest, meta: Meta) -> VehicleState:
        what = MotorAction.ARM if request.armed else MotorAction.DISARM
        return self._done(what, "", meta, lambda: self._core.on_arm(request.armed, self._module.now_ns()))

    def _kill(self, request: KillRequest, meta: Meta) -> VehicleState:
        return self._done(MotorAction.KILL, request.reason, meta, lambda: self._killed(request.platform))

    def _killed(self, named: str) -> tuple[VehicleState, list[Action]]:
        if named != self._module.platform:
            raise Denied(f"kill of {named!r}: this is {self._module.platform}; expected its own name")
        return self._core.on_kill(self._module.now_ns())

    def _done(self, what: MotorAction, reason: str, meta: Meta, order_motors: OrderMotors) -> VehicleState:
        by = requester(self._module, meta)
        order = MotorOrder(what, by, round(self._vehicle.pose().z_m, 2), reason)
        try:
            state, actions = order_motors()
        except Denied as error:
            self._orders.write(msgspec.structs.replace(order, refused=str(error)))
            self._module.log.warning("%s by %s: refused: %s", what, by, error)
            raise
        self._feed(actions)
        self._orders.write(order)
        level = logging.WARNING if what is MotorAction.KILL else logging.INFO
        self._module.log.log(level, "%s by %s %s", what, by, reason)
        return state
