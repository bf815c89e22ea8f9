"""The navigator's shell: boards in, boards out, at a fixed rate; gains change while it runs (S2.46)."""

from typing import ClassVar, Final

from swarmd.navigator import config as settings
from swarmd.navigator.core.air_controller import AirController
from swarmd.navigator.core.navigator import Controller, NavigatorCore
from swarmd.navigator.inputs import Inputs
from swarmware.geometry.world import World
from swarmware.model import paths
from swarmware.model.config import load
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.module import Module
from swarmware.service.live_config import LiveConfig
from swarmware.service.service import Service
from swarmware.types.vehicle import NavStatus, Pose, Setpoint

_SETTINGS_EVERY: Final = 10
"""Control steps between two checks of the parameters."""


class Navigator(Service):
    """Estimates the pose and steers the vehicle to the goal of the mission."""

    name = "navigator"
    Config: ClassVar = settings.Config
    live_settings: ClassVar = {
        "dwa.heading_weight": "navigator/heading_weight",
        "dwa.distance_weight": "navigator/distance_weight",
        "dwa.velocity_weight": "navigator/velocity_weight",
        "altitude.kp_1_s": "navigator/altitude_kp",
        "altitude.ki_1_s2": "navigator/altitude_ki",
        "altitude.kd": "navigator/altitude_kd",
        "air.kp_1_s": "navigator/position_kp",
    }
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        node = module.node.config
        world = load(paths.world(node.share_path, config.world), World)
        self._core = NavigatorCore(config, module.platform, world.origin, controller(node.kind, config))
        self._inputs = Inputs(module)
        self._live = LiveConfig(module, config, self.live_settings)
        self._poses = module.writer(
            "nav/pose", Pose, rate_hz=config.rate_hz, description="Estimated pose and velocity"
        )
        self._setpoints = module.writer(
            "act/setpoint", Setpoint, rate_hz=config.rate_hz, description="Set-point of velocity and yaw rate"
        )
        self._statuses = module.writer(
            "nav/status", NavStatus, rate_hz=config.status_hz, description="Progress towards the goal"
        )

    async def run(self) -> None:
        """Runs the control loop until the service ends."""
        module, navigator = self.module, self._core
        ticker = module.every(navigator.period_s(), stage=2)
        async for tick in ticker:
            now_ns = module.now_ns()
            if tick % _SETTINGS_EVERY == 0 and (changed := self._live.take()) is not None:
                navigator.set_config(changed)
            self._inputs.feed(navigator, now_ns)
            step = navigator.step(now_ns)
            self._setpoints.write(step.setpoint, now_ns)
            if step.pose is not None:
                self._poses.write(step.pose, now_ns)
            if step.status is not None:
                self._statuses.write(step.status, now_ns)
                module.log.debug("goal %d: %s", step.status.goal_seq, step.status.state)
            ticker.retime(navigator.period_s())

    async def stop(self) -> None:
        """Writes a last set-point that stops the vehicle."""
        self._setpoints.write(Setpoint(0.0))


def controller(kind: PlatformKind, config: settings.Config) -> Controller:
    """The controller for a kind of platform."""
    if kind == PlatformKind.UAV:
        return AirController(config)
    from swarmd.navigator.core.ground_controller import GroundController

    return GroundController(config)
