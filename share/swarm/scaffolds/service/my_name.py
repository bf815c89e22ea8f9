"""The service my_name: the distance of the vehicle from the origin of the map."""

import math
from typing import Annotated, ClassVar

import msgspec
from swarmware import Module, Service
from swarmware.types.scalar import Float
from swarmware.types.vehicle import Pose


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings: the file services/my_name.toml of the node's configuration."""

    rate_hz: Annotated[float, msgspec.Meta(gt=0, le=100)] = 2.0
    """Rate of the board `my_name/distance`."""
    limit_m: Annotated[float, msgspec.Meta(gt=0)] = 100.0
    """Distance beyond which the health monitor reports a warning."""


class MyName(Service):
    """Reads `nav/pose`, publishes `my_name/distance`."""

    name = "my_name"
    Config: ClassVar = Settings
    config: Settings

    def __init__(self, module: Module, config: Settings) -> None:
        super().__init__(module, config)
        self._pose = module.reader("nav/pose", Pose)
        self._distance = module.writer(
            "my_name/distance",
            Float,
            unit="m",
            rate_hz=config.rate_hz,
        )

    async def run(self) -> None:
        """Run until the node stops the service; an error restarts it."""
        self.health.register(
            "distance",
            frequency_hz=self.config.rate_hz,
            data=self.distance_m,
            criterion=self.state,
        )
        async for _ in self.module.every(1 / self.config.rate_hz):
            self._distance.write(Float(self.distance_m()))

    def state(self, distance_m: float) -> str:
        """State of the vehicle for the health monitor: `warn` beyond the limit."""
        return "warn" if distance_m > self.config.limit_m else "ok"

    def distance_m(self) -> float:
        """Distance from the origin; zero before the first pose."""
        pose = self._pose.value
        return 0.0 if pose is None else math.hypot(pose.x_m, pose.y_m, pose.z_m)
