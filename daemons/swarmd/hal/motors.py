"""Requests to arm, disarm and kill the motors and to calibrate their controllers, served for the chassis."""

import logging

import msgspec

from swarmd.hal.chassis import Chassis
from swarmware.errors import Denied, SwarmError
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.module.requester import requester
from swarmware.types.chassis import CalibrationRequest, ChassisAction, GainsRequest
from swarmware.types.vehicle import (
    ArmRequest,
    KillRequest,
    MotorAction,
    MotorOrder,
    Pose,
    VehicleState,
)


class Motors:
    """Serves requests to the motors, independent of mission and navigator, with an audit log."""

    def __init__(self, module: Module, chassis: Chassis) -> None:
        self._module = module
        self._chassis = chassis
        self._pose = module.reader("nav/pose", Pose)
        self._orders = module.stream_writer(
            "vehicle/orders",
            MotorOrder,
            kind="event",
            log="all",
            description="Audit log: each request to the motors, with its sender",
        )

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
        serve(
            "sys/vehicle/calibrate",
            CalibrationRequest,
            self._calibrate,
            reply=VehicleState,
            description="Calibrate the motor controllers of a disarmed vehicle; the motors may turn",
        )

        serve(
            "sys/vehicle/gains",
            GainsRequest,
            self._set_gains,
            reply=VehicleState,
            description="Change gains of the controllers of the chassis",
        )

    async def _set_gains(self, request: GainsRequest, meta: Meta) -> VehicleState:
        names = ", ".join(f"{name}={value:g}" for name, value in request.gains.items())
        refusal = "" if names else "gains: none given, expected at least one"
        return await self._done(
            MotorAction.GAINS, ChassisAction.GAINS, names, meta, refusal, gains=request.gains
        )

    async def _arm(self, request: ArmRequest, meta: Meta) -> VehicleState:
        if request.armed:
            return await self._done(MotorAction.ARM, ChassisAction.ARM, "", meta)
        return await self._done(MotorAction.DISARM, ChassisAction.DISARM, "", meta)

    async def _kill(self, request: KillRequest, meta: Meta) -> VehicleState:
        return await self._done(
            MotorAction.KILL,
            ChassisAction.KILL,
            request.reason,
            meta,
            self._misnamed("kill", request.platform),
        )

    async def _calibrate(self, request: CalibrationRequest, meta: Meta) -> VehicleState:
        return await self._done(
            MotorAction.CALIBRATE,
            ChassisAction.CALIBRATE,
            "",
            meta,
            self._misnamed("calibration", request.platform) or self._moving(),
        )

    def _misnamed(self, what: str, named: str) -> str:
        if named == self._module.platform:
            return ""
        return f"{what} of {named!r}: this is {self._module.platform}; expected its own name"

    def _moving(self) -> str:
        state = self._chassis.state
        if state is not None and state.resting:
            return ""
        return "calibration: expected a vehicle that is disarmed and on the ground"

    async def _done(
        self,
        what: MotorAction,
        action: ChassisAction,
        reason: str,
        meta: Meta,
        refusal: str = "",
        *,
        gains: dict[str, float] | None = None,
    ) -> VehicleState:
        by = requester(self._module, meta)
        pose = self._pose.value
        order = MotorOrder(what, by, 0.0 if pose is None else round(pose.z_m, 2), reason)
        try:
            if refusal:
                raise Denied(refusal)
            state = await self._chassis.execute(action, gains)
        except SwarmError as error:
            self._orders.write(msgspec.structs.replace(order, refused=str(error)))
            self._module.log.warning("%s by %s: refused: %s", what, by, error)
            raise
        self._orders.write(order)
        level = logging.WARNING if what is MotorAction.KILL else logging.INFO
        self._module.log.log(level, "%s by %s %s", what, by, reason)
        return state
