"""The battery: energy drawn, and none below empty."""

from swarmd.sim.config import BatteryConfig
from swarmd.sim.core.simulation import Battery


def test_energy_falls_by_use_never_below_zero() -> None:
    config = BatteryConfig(capacity_wh=1.0, start_ratio=1.0)
    pack = Battery(config)
    pack.draw(1800.0, 1.0)
    assert pack.ratio == 0.5
    assert pack.state().remaining_ratio == 0.5
    assert config.voltage_empty_v < pack.state().voltage_v < config.voltage_full_v
    pack.draw(1800.0, 60.0)
    assert pack.empty
    assert (pack.ratio, pack.state().voltage_v) == (0.0, config.voltage_empty_v)
