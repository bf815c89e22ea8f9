"""The navigator's shell: boards in, boards out, at a fixed rate; gains change while it runs (S2.46)."""

from typing import ClassVar, Final

import msgspec

from swarmd.navigator import config as settings
from swarmd.navigator.core.air_controller import AirController
from swarmd.navigator.core.navigator import Controller, NavigatorCore
from swarmd.navigator.inputs import Fresh, Inputs
from swarmware.geometry.world import World
from swarmware.model import paths
from swarmware.model.config import load
from swarmware.model.platform_kind import PlatformKind
from swarmware.module.module import Module
from swarmware.service.service import Service
from swarmware.types.scalar import Float
from swarmware.types.vehicle import NavStatus, Pose, Setpoint

GAINS: Final = {
    "heading_weight": ("dwa", "heading_weight"),
    "distance_weight": ("dwa", "distance_weight"),
    "velocity_weight": ("dwa", "velocity_weight"),
    "altitude_kp": ("altitude", "kp_1_s"),
    "altitude_ki": ("altitude", "ki_1_s2"),
    "altitude_kd": ("altitude", "kd"),
    "position_kp": ("air", "kp_1_s"),
}
"""Parameter `config/navigator/<name>`: table and key of the configuration that it overrides."""

_SETTINGS_EVERY: Final = 10
"""Control steps between two checks of the parameters."""


class Navigator(Service):
    """Estimates the pose and steers the vehicle to the goal of the mission."""

    name = "navigator"
    Config: ClassVar = settings.Config
    live_settings: ClassVar = {f"{table}.{key}": f"navigator/{name}" for name, (table, key) in GAINS.items()}
    config: settings.Config

    def __init__(self, module: Module, config: settings.Config) -> None:
        super().__init__(module, config)
        node = module.node.config
        world = load(paths.world(node.share_path, config.world), World)
        self._core = NavigatorCore(config, module.platform, world.origin, controller(node.kind, config))
        self._inputs = Inputs(module)
        self._gains = {
            name: Fresh(module.reader(paths.setting(f"navigator/{name}"), Float)) for name in GAINS
        }
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
        module, navigator, current = self.module, self._core, self.config
        ticker = module.every(navigator.period_s(), stage=2)
        async for tick in ticker:
            now_ns = module.now_ns()
            if tick % _SETTINGS_EVERY == 0:
                news = {name: new.value for name, board in self._gains.items() if (new := board.take())}
                changed = with_gains(current, news)
                if changed != current:
                    current = changed
                    navigator.set_config(current)
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


def with_gains(config: settings.Config, gains: dict[str, float]) -> settings.Config:
    """The configuration with some gains overridden."""
    for name, value in gains.items():
        table, key = GAINS[name]
        part = msgspec.structs.replace(getattr(config, table), **{key: value})
        config = msgspec.structs.replace(config, **{table: part})
    return config
