"""Model of a battery with energy and voltage."""

from swarmd.sim.config import BatteryConfig
from swarmware.types.vehicle import BatteryState


class Battery:
    """Energy store of one vehicle; the voltage is linear in the state of charge."""

    __slots__ = ("_config", "_energy_wh", "_power_w")

    def __init__(self, config: BatteryConfig) -> None:
        self._config = config
        self._energy_wh = config.capacity_wh * config.start_ratio
        self._power_w = 0.0

    @property
    def ratio(self) -> float:
        """State of charge, the ratio of remaining energy to capacity."""
        return self._energy_wh / self._config.capacity_wh

    @property
    def empty(self) -> bool:
        """True if the battery is empty, when the motors stop."""
        return self._energy_wh <= 0.0

    def draw(self, power_w: float, dt_s: float) -> None:
        """Draws power for the duration of a sample."""
        self._power_w = power_w
        self._energy_wh = max(0.0, self._energy_wh - power_w * dt_s / 3600)

    def state(self) -> BatteryState:
        """The state that the battery monitor reports."""
        config = self._config
        voltage = config.voltage_empty_v + self.ratio * (config.voltage_full_v - config.voltage_empty_v)
        return BatteryState(round(voltage, 3), round(self._power_w / voltage, 3), round(self.ratio, 5))
