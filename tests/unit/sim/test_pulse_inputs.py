"""A simulated airframe behind pulses: the files of a chip become outputs of its motors and servos."""

from pathlib import Path

import pytest

from swarmd.sim.pulse_inputs import PulseInputs
from swarmware.errors import ConfigError
from swarmware.model.airframe_file import load_airframe
from swarmware.types.chassis import ActuatorOutputs

SHARE = Path(__file__).parents[3] / "share/swarm"


def pulses(folder: Path, number: int, width_us: float, *, enabled: bool = True) -> None:
    channel = folder / "pwmchip0" / f"pwm{number}"
    (channel / "duty_cycle").write_text(f"{round(width_us * 1000)}\n")
    (channel / "enable").write_text(f"{int(enabled)}\n")


def test_motors_follow_pulses_and_stop_without(tmp_path: Path) -> None:
    inputs = PulseInputs(tmp_path, load_airframe(SHARE, "quad_1k5"))
    assert inputs.outputs() == ActuatorOutputs((0.0,) * 4)
    for number, width_us in enumerate((1000, 1500, 2000, 2400)):
        pulses(tmp_path, number, width_us)
    assert inputs.outputs().motors == (0.0, 0.5, 1.0, 1.0)
    pulses(tmp_path, 2, 2000, enabled=False)
    (tmp_path / "pwmchip0/pwm3/duty_cycle").write_text("")
    assert inputs.outputs().motors == (0.0, 0.5, 0.0, 0.0), "no pulses, and a file that is being written"
    inputs.close()
    assert not (tmp_path / "pwmchip0").exists(), "unplugged"


def test_helicopter_servos_follow_and_centre_without_pulses(tmp_path: Path) -> None:
    inputs = PulseInputs(tmp_path, load_airframe(SHARE, "helicopter"))
    assert inputs.outputs() == ActuatorOutputs((0.0,), (0.0,) * 4)
    for number, width_us in enumerate((2000, 1000, 1250, 1500, 2600)):
        pulses(tmp_path, number, width_us)
    assert inputs.outputs() == ActuatorOutputs((1.0,), (-1.0, -0.5, 0.0, 1.0))
    inputs.close()


def test_fixed_wing_pulses_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"serial\.folder: a fixed wing has no PWM driver"):
        PulseInputs(tmp_path, load_airframe(SHARE, "fixed_wing"))
