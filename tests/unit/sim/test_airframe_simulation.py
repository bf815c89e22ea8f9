"""The simulation of a vehicle with an airframe: rates, stalls, battery, and stops of the motors."""

import random
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from swarmd.sim.config import Config
from swarmd.sim.core.simulation import Simulation, SimulationOutput
from swarmware.geometry.world import Bounds, World
from swarmware.model.airframe import MultirotorAirframe
from swarmware.model.airframe_file import load_airframe
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.chassis import ActuatorOutputs, ChassisAction, ChassisOrder
from swarmware.types.vehicle import Pose

MS = 1_000_000
SHARE = Path(__file__).parents[3] / "share/swarm"
WORLD = World(description="", bounds=Bounds(x_m=(-50.0, 50.0), y_m=(-50.0, 50.0), z_m=(-1.0, 50.0)))


def quadrotor() -> MultirotorAirframe:
    found = load_airframe(SHARE, "quad_1k5")
    assert isinstance(found, MultirotorAirframe)
    return found


FRAME = quadrotor()
HOVER = ActuatorOutputs((0.721,) * 4)
"""Carries about the weight."""


def simulation(
    height_m: float = 0.0, config: Config | None = None, frame: MultirotorAirframe = FRAME
) -> Simulation:
    chance = random.Random(1)
    start = Pose.planar(0.0, 0.0, height_m)
    made = Simulation(config or Config(), WORLD, PlatformKind.UAV, start, chance.gauss, chance.random, frame)
    made.on_order(ChassisOrder(1, ChassisAction.ARM))
    made.vehicle.armed = True
    return made


def samples(
    flown: Simulation, first_ms: int, last_ms: int, step: Callable[[int], None] = lambda _: None
) -> list[SimulationOutput]:
    """Outputs while it is called each 10 ms."""
    found = []
    for ms in range(first_ms, last_ms, 10):
        step(ms * MS)
        output = flown.advance(ms * MS)
        if output is not None:
            found.append(output)
    return found


def test_inertial_unit_has_control_rate_others_own() -> None:
    found = samples(simulation(10.0), 1000, 2000)
    counts = [
        sum(getattr(output, name) is not None for output in found)
        for name in ("imu", "sonar", "gnss", "scan", "battery")
    ]
    assert counts == [100, 20, 10, 10, 1]


def test_a_faster_airframe_is_sampled_faster() -> None:
    flown = simulation(10.0, frame=msgspec.structs.replace(FRAME, control_hz=200.0))
    assert flown.imu_hz == flown.output_hz == 200.0


def test_disarmed_grounded_vehicle_is_sampled_at_rest() -> None:
    flown = simulation()
    flown.on_order(ChassisOrder(2, ChassisAction.DISARM))
    samples(flown, 1000, 1500)
    found = [output for output in samples(flown, 1500, 2500) if output.imu is not None]
    assert len(found) == 5


def test_inertial_unit_feels_turn_but_no_fall() -> None:
    flown = simulation(20.0)
    lopsided = ActuatorOutputs((0.6, 0.65, 0.65, 0.6))
    last = samples(flown, 1000, 1300, lambda now_ns: flown.on_command(lopsided, now_ns - MS))[-1]
    assert last.imu is not None
    assert last.imu.wx_rad_s > 0.2
    flown.on_order(ChassisOrder(3, ChassisAction.KILL))
    falling = samples(flown, 1300, 1800)[-1]
    assert falling.imu is not None
    assert abs(falling.imu.az_m_s2) < 1.5


def test_outputs_that_are_too_old_stop_the_motors() -> None:
    flown = simulation(30.0)
    samples(flown, 1000, 1100, lambda now_ns: flown.on_command(HOVER, now_ns - MS))
    held = samples(flown, 1100, 2050)[-1].truth.vz_m_s
    fallen = samples(flown, 2050, 3050)[-1].truth.vz_m_s
    assert abs(held) < 1.5
    assert fallen - held < -6.0


def test_output_hold_time_is_airframe_setting() -> None:
    body = msgspec.structs.replace(FRAME.body, outputs_held_s=0.3)
    flown = simulation(30.0, frame=msgspec.structs.replace(FRAME, body=body))
    samples(flown, 1000, 1100, lambda now_ns: flown.on_command(HOVER, now_ns - MS))
    assert samples(flown, 1100, 1900)[-1].truth.vz_m_s < -3.0


def test_stalled_computer_world_continues_with_last_outputs() -> None:
    flown = simulation(30.0)
    samples(flown, 1000, 1500, lambda now_ns: flown.on_command(HOVER, now_ns - MS))
    (after,) = samples(flown, 2400, 2410)
    assert abs(after.truth.vz_m_s) < 1.5, "outputs are held for a second"
    (after,) = samples(flown, 3400, 3410)
    assert after.truth.vz_m_s == pytest.approx(-9.0, abs=1.5), "then the motors stop"


def test_only_begin_of_long_stall_is_simulated() -> None:
    flown = simulation(48.0)
    flown.on_order(ChassisOrder(4, ChassisAction.KILL))
    samples(flown, 1000, 1010)
    (after,) = samples(flown, 3_600_000, 3_600_010)
    assert 20.0 < after.truth.z_m < 28.0, "2.5 s of a fall"
    (next_one,) = samples(flown, 3_600_010, 3_600_020)
    assert next_one.stamp_ns == 3_600_010 * MS
    assert after.truth.z_m - next_one.truth.z_m < 0.5


def test_the_battery_is_that_of_the_airframe() -> None:
    flown = simulation(10.0)

    def carry(now_ns: int) -> None:
        flown.on_command(HOVER, now_ns - MS)

    states = [output.battery for output in samples(flown, 1000, 4000, carry) if output.battery is not None]
    used_wh = (states[0].remaining_ratio - states[-1].remaining_ratio) * FRAME.battery_wh
    power_w = FRAME.motor.hover_w + FRAME.motor.idle_w
    assert used_wh == pytest.approx(power_w * (len(states) - 1) / 3600, rel=0.15)
