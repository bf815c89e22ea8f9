"""The navigator's shell: boards in, boards out, at a fixed rate; gains change while it runs (S2.46)."""

from typing import ClassVar, Final

import msgspec

from swarmd.navigator import config as settings
from swarmd.navigator.core.air_pilot import AirPilot
from swarmd.navigator.core.navigator import Navigator as Core
from swarmd.navigator.core.navigator import Pilot
from swarmd.navigator.inputs import Fresh, Inputs
from swarmware.config import load
from swarmware.errors import missing_extra
from swarmware.module import BoardWriter
from swarmware.service import Service
from swarmware.types.scalar import Float
from swarmware.types.vehicle import NavStatus, Pose, Setpoint
from swarmware.world import World

GAINS: Final = {
    "heading_weight": ("dwa", "heading_weight"),
    "distance_weight": ("dwa", "distance_weight"),
    "velocity_weight": ("dwa", "velocity_weight"),
    "altitude_kp": ("altitude", "kp_1_s"),
    "altitude_ki": ("altitude", "ki_1_s2"),
    "altitude_kd": ("altitude", "kd"),
    "position_kp": ("air", "kp_1_s"),
}
"""Setting `config/navigator/<name>`: table and key of the configuration that it replaces."""

_SETTINGS_EVERY: Final = 10
"""Steps between two looks at the settings."""


class Navigator(Service):
    """Estimates the pose, follows the goal of the mission."""

    name = "navigator"
    Config: ClassVar = settings.Config
    config: settings.Config

    async def run(self) -> None:
        """Steps until the service ends."""
        module, node = self.module, self.module.node
        world = load(node.config.share_path / "worlds" / f"{self.config.world}.toml", World)
        navigator = Core(self.config, module.platform, world.origin, pilot(node.config.kind, self.config))
        inputs = Inputs(module)
        await inputs.open()
        gains = {name: Fresh(await module.reader(f"config/navigator/{name}", Float)) for name in GAINS}
        pose_board: BoardWriter[Pose] = await module.writer(
            "nav/pose", Pose, rate_hz=self.config.rate_hz, description="Estimated pose and velocity"
        )
        setpoints: BoardWriter[Setpoint] = await module.writer(
            "act/setpoint", Setpoint, rate_hz=self.config.rate_hz, description="What the vehicle shall do now"
        )
        self._setpoints = setpoints
        statuses: BoardWriter[NavStatus] = await module.writer(
            "nav/status", NavStatus, rate_hz=self.config.status_hz, description="Progress towards the goal"
        )
        current = self.config
        async for tick in module.every(1 / self.config.rate_hz, stage=2):
            now_ns = module.now_ns()
            if tick % _SETTINGS_EVERY == 0:
                news = {name: new.value for name, board in gains.items() if (new := board.take())}
                changed = with_gains(current, news)
                if changed != current:
                    current = changed
                    navigator.set_config(current)
            inputs.feed(navigator, now_ns)
            step = navigator.on_timer(now_ns)
            setpoints.write(step.setpoint, now_ns)
            if step.pose is not None:
                pose_board.write(step.pose, now_ns)
            if step.status is not None:
                statuses.write(step.status, now_ns)
                module.log.debug("goal %d: %s", step.status.goal_seq, step.status.state)

    async def stop(self) -> None:
        """The last word to the vehicle: stand still."""
        if (setpoints := getattr(self, "_setpoints", None)) is not None:
            setpoints.write(Setpoint(0.0))


def pilot(kind: str, config: settings.Config) -> Pilot:
    """The pilot for a kind of platform."""
    if kind == "uav":
        return AirPilot(config)
    try:
        # brings numpy, which a node that flies does not need
        from swarmd.navigator.core.ground_pilot import GroundPilot
    except ImportError as error:
        raise missing_extra("planner of ground vehicles", error, "nav") from error

    return GroundPilot(config)


def with_gains(config: settings.Config, gains: dict[str, float]) -> settings.Config:
    """The configuration with some gains replaced."""
    for name, value in gains.items():
        table, key = GAINS[name]
        part = msgspec.structs.replace(getattr(config, table), **{key: value})
        config = msgspec.structs.replace(config, **{table: part})
    return config
