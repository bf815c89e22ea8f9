"""The service `estimator`, which estimates the pose for a guidance on another computer."""

from contextlib import suppress
from typing import ClassVar

from swarmd.navigator import config as settings
from swarmd.navigator.core.estimator import PoseEstimation
from swarmd.navigator.core.input_delay import DelayMeter
from swarmd.navigator.core.pace import Pace
from swarmd.navigator.inputs import Fresh, SensorInputs, StateInputs, hovers, map_origin
from swarmd.navigator.outputs import delay_writer, pose_writer, publish_origin
from swarmware.errors import NoAnswer
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.module import Module
from swarmware.service.service import Service
from swarmware.types.vehicle import Setpoint


class PoseEstimator(Service):
    """Estimates the pose of the platform, with a step for each inertial measurement."""

    name = "estimator"
    Config: ClassVar = settings.Config
    settings_of: ClassVar = "navigator"
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        self._core = PoseEstimation(
            config.estimator,
            map_origin(module, config),
            flies=module.node.config.kind == PlatformKind.UAV,
            hovers=hovers(module),
        )
        self._sensors = SensorInputs(module, within_s=1 / config.rate_hz)  # else it enters a later step
        self._state = StateInputs(module)
        self._setpoint = Fresh(module.reader("act/setpoint", Setpoint))
        self._poses = pose_writer(module, config)
        self._delays, self._delay_board = DelayMeter(), delay_writer(module, "nav/imu_delay")
        publish_origin(module, map_origin(module, config))

    async def run(self) -> None:
        """Estimates until the service ends."""
        module, core, imu = self.module, self._core, self._sensors.imu
        pace = Pace()
        while True:
            period_s = self.config.period_s(resting=core.resting)
            with suppress(NoAnswer):
                await imu.changed(timeout_s=pace.wait_s(period_s))
                self._delays.on_value(imu.local_stamp_ns, module.now_ns())
            now_ns = module.now_ns()
            self._sensors.feed(core, now_ns)
            self._state.feed(core)
            if (setpoint := self._setpoint.take()) is not None:
                core.on_setpoint(setpoint)
            if pace.take(now_ns, period_s) and (pose := core.step(now_ns)) is not None:
                self._poses.write(pose, now_ns)
            if (delays := self._delays.take(now_ns)) is not None:
                self._delay_board.write(delays)
