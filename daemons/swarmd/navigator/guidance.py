"""The service `guidance`, which steers by the pose that an estimator on another computer publishes."""

from contextlib import suppress
from typing import ClassVar

from swarmd.navigator import config as settings
from swarmd.navigator.core.controller import controller
from swarmd.navigator.core.guidance import Guidance
from swarmd.navigator.core.input_delay import DelayMeter
from swarmd.navigator.core.pace import Pace
from swarmd.navigator.core.prediction import ReceivedPose
from swarmd.navigator.inputs import Fresh, GuidanceInputs, StateInputs, vehicle_airframe
from swarmd.navigator.outputs import LIVE_SETTINGS, GuidanceWriters, delay_writer
from swarmware.errors import NoAnswer
from swarmware.module.module import Module
from swarmware.service.live_config import LiveConfig
from swarmware.service.service import Service
from swarmware.types.vehicle import Pose


class GuidanceService(Service):
    """Steers the vehicle to the goal of the mission, with a step for each pose of the estimator."""

    name = "guidance"
    Config: ClassVar = settings.Config
    settings_of: ClassVar = "navigator"
    live_settings: ClassVar = LIVE_SETTINGS
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        self._core = Guidance(
            config, module.platform, controller(module.node.config.kind, config, vehicle_airframe(module))
        )
        self._pose = ReceivedPose(config.pose_timeout_s)
        self._poses = Fresh(module.reader("nav/pose", Pose, within_s=config.pose_timeout_s))
        self._state = StateInputs(module)
        self._guidance = GuidanceInputs(module)
        self._live = LiveConfig(module, config, self.live_settings)
        self._writers = GuidanceWriters(module, config)
        self._delays, self._delay_board = DelayMeter(), delay_writer(module, "nav/pose_delay")

    async def run(self) -> None:
        """Steers until the service ends."""
        module, core = self.module, self._core
        pace = Pace()
        while True:
            period_s = self.config.period_s(resting=core.resting)
            with suppress(NoAnswer):
                await self._poses.reader.changed(timeout_s=pace.wait_s(period_s))
                self._delays.on_value(self._poses.reader.local_stamp_ns, module.now_ns())
            now_ns = module.now_ns()
            if (pose := self._poses.take()) is not None:
                self._pose.on_pose(pose, self._poses.stamp_ns(now_ns))
            self._state.feed(core)
            self._guidance.feed(core, now_ns)
            if (delays := self._delays.take(now_ns)) is not None:
                self._delay_board.write(delays)
            if not pace.take(now_ns, period_s):
                continue
            if (changed := self._live.take()) is not None:
                core.set_config(changed)
            output = core.step(self._pose.at(now_ns), now_ns)
            self._writers.write(output.setpoint, output.status, now_ns)

    async def stop(self) -> None:
        """Publishes a last set-point, which stops the vehicle."""
        self._writers.stop()
