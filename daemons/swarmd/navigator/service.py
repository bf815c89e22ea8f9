"""The navigator's shell, which reads and writes boards at a fixed rate, with gains that change live
(S2.46)."""

from typing import ClassVar

from swarmd.navigator import config as settings
from swarmd.navigator.core.controller import controller
from swarmd.navigator.core.navigator import NavigatorCore
from swarmd.navigator.inputs import GuidanceInputs, SensorInputs, StateInputs, map_origin, vehicle_airframe
from swarmd.navigator.outputs import LIVE_SETTINGS, GuidanceWriters, pose_writer, publish_origin
from swarmware.module.module import Module
from swarmware.service.live_config import LiveConfig
from swarmware.service.service import Service


class Navigator(Service):
    """Estimates the pose and steers the vehicle to the goal of the mission."""

    name = "navigator"
    Config: ClassVar = settings.Config
    live_settings: ClassVar = LIVE_SETTINGS
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        steers = controller(module.node.config.kind, config, vehicle_airframe(module))
        self._core = NavigatorCore(config, module.platform, map_origin(module, config), steers)
        self._sensors = SensorInputs(module)
        self._state = StateInputs(module)
        self._guidance = GuidanceInputs(module)
        self._live = LiveConfig(module, config, self.live_settings)
        self._poses = pose_writer(module, config)
        publish_origin(module, map_origin(module, config))
        self._writers = GuidanceWriters(module, config)

    async def run(self) -> None:
        """Runs the control loop until the service ends."""
        module, navigator = self.module, self._core
        ticker = module.every(navigator.period_s(), stage=2)
        async for _ in ticker:
            now_ns = module.now_ns()
            if (changed := self._live.take()) is not None:
                navigator.set_config(changed)
            self._sensors.feed(navigator, now_ns)
            self._state.feed(navigator)
            self._guidance.feed(navigator, now_ns)
            step = navigator.step(now_ns, ticker.late_ns)
            self._writers.write(step.setpoint, step.status, now_ns)
            if step.pose is not None:
                self._poses.write(step.pose, now_ns)
            ticker.retime(navigator.period_s())

    async def stop(self) -> None:
        """Publishes a last set-point, which stops the vehicle."""
        self._writers.stop()
