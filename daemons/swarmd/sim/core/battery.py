"""The accumulator: energy drawn, voltage left."""

from swarmd.sim.config import Battery
from swarmware.types.vehicle import BatteryState


class Accumulator:
    """Energy of one vehicle; the voltage falls in a straight line, which is enough to act on."""

    __slots__ = ("_config", "_left_wh", "_power_w")

    def __init__(self, config: Battery) -> None:
        self._config = config
        self._left_wh = config.capacity_wh * config.start_ratio
        self._power_w = 0.0

    @property
    def ratio(self) -> float:
        """Energy left, of a full one."""
        return self._left_wh / self._config.capacity_wh

    @property
    def empty(self) -> bool:
        """Nothing left: the motors stop."""
        return self._left_wh <= 0.0

    def draw(self, power_w: float, dt_s: float) -> None:
        """Energy used in a sample."""
        self._power_w = power_w
        self._left_wh = max(0.0, self._left_wh - power_w * dt_s / 3600)

    def state(self) -> BatteryState:
        """As its own gauge shows it."""
        config = self._config
        voltage = config.voltage_empty_v + self.ratio * (config.voltage_full_v - config.voltage_empty_v)
        return BatteryState(round(voltage, 3), round(self._power_w / voltage, 3), round(self.ratio, 5))
