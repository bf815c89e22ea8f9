"""Service of the requests to arm, disarm and kill the motors, and to calibrate their controllers."""

import logging

import msgspec

from swarmd.hal.arming_gate import ArmingGate
from swarmd.hal.chassis import Chassis
from swarmware.errors import Denied, SwarmError
from swarmware.module.meta import Meta
from swarmware.module.module import Module
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
        self._gate = ArmingGate(module)
        self._stops = 0
        """Number of requests to disarm or kill, each of which cancels an arming that waits at the gate."""
        self._pose = module.reader("nav/pose", Pose)
        self._orders = module.stream_writer(
            "vehicle/orders",
            MotorOrder,
            kind="event",
            log="all",
            description="Audit log: each request to the motors, with its sender",
        )

    def serve(self) -> None:
        """Registers the handlers of the vehicle's requests."""
        serve = self._module.serve
        serve(
            "sys/vehicle/arm",
            ArmRequest,
            self._arm,
            reply=VehicleState,
            description="Arm or disarm the motors; arming is refused while the vehicle is not ready",
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
        refusal = "" if names else "gains: empty; expected at least one gain"
        return await self._done(
            MotorAction.GAINS, ChassisAction.GAINS, names, meta, refusal, gains=request.gains
        )

    async def _arm(self, request: ArmRequest, meta: Meta) -> VehicleState:
        if not request.armed:
            self._stops += 1
            return await self._done(MotorAction.DISARM, ChassisAction.DISARM, request.reason, meta)
        refusal = overridden = ""
        if request.force:
            overridden = self._gate.reasons()
        elif not self._flies():  # a vehicle in the air is armed already
            stops = self._stops
            refusal = await self._gate.refusal()
            # a later order to stop has precedence over an arming that waited at the gate
            if stops != self._stops:
                refusal = "arm: a later order replaced it"
        return await self._done(
            MotorAction.ARM, ChassisAction.ARM, request.reason, meta, refusal, overridden=overridden
        )

    def _flies(self) -> bool:
        state = self._chassis.state
        return state is not None and not state.landed

    async def _kill(self, request: KillRequest, meta: Meta) -> VehicleState:
        self._stops += 1
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
        overridden: str = "",
    ) -> VehicleState:
        by = self._module.requester(meta)
        pose = self._pose.value
        # made before the execution, so that it has the height at which the order came
        order = MotorOrder(
            what, by, 0.0 if pose is None else round(pose.z_m, 2), reason, overridden=overridden
        )
        try:
            if refusal:
                raise Denied(refusal)
            state = await self._chassis.execute(action, gains)
        except SwarmError as error:
            # the audit log includes refused requests
            self._orders.write(msgspec.structs.replace(order, refused=str(error)))
            self._module.log.warning("%s by %s: refused: %s", what, by, error)
            raise
        self._orders.write(order)
        level = logging.WARNING if what is MotorAction.KILL or overridden else logging.INFO
        forced = f"; forced although not ready: {overridden}" if overridden else ""
        self._module.log.log(level, "%s by %s %s%s", what, by, reason, forced)
        return state
