"""The simulation: fixed instants, arming, contacts, battery, stalls."""

import random

import pytest

from swarmd.sim.config import BatteryConfig, Config
from swarmd.sim.core.simulation import BOUNDS, GROUND, Simulation, SimulationOutput
from swarmware.errors import Denied
from swarmware.geometry.world import Bounds, Circle, World
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.vehicle import Pose, Setpoint

WORLD = World(
    description="",
    bounds=Bounds(x_m=(-20.0, 20.0), y_m=(-20.0, 20.0)),
    circles=(Circle(name="boulder", x_m=3.0, y_m=0.0, radius_m=0.5, height_m=1.0),),
)
STEP_NS = 25_000_000


class Run:
    """A simulation with one set-point, and all of its outputs."""

    def __init__(self, kind: str = "ugv", config: Config | None = None, start: Pose | None = None) -> None:
        chance = random.Random(1)
        self.simulation = Simulation(
            config or Config(),
            WORLD,
            PlatformKind(kind),
            start or Pose.planar(0.0, 0.0),
            chance.gauss,
            chance.random,
        )
        self.now_ns = 5_000_000_000
        self.samples: list[SimulationOutput] = []

    def go(self, seconds: float, wanted: Setpoint | None = None, step_ns: int = STEP_NS) -> "Run":
        for _ in range(round(seconds * 1e9 / step_ns)):
            self.now_ns += step_ns
            if wanted is not None:
                self.simulation.on_command(wanted, self.now_ns)
            sample = self.simulation.advance(self.now_ns)
            if sample is not None:
                self.samples.append(sample)
        return self

    @property
    def hits(self) -> list[str]:
        return [hit.other for sample in self.samples for hit in sample.collisions]


def test_samples_lie_at_fixed_instants() -> None:
    run = Run()
    run.simulation.advance(run.now_ns)
    run.simulation.on_arm(True)
    chance = random.Random(2)
    for _ in range(500):
        run.now_ns += chance.randrange(1, 60_000_000)
        sample = run.simulation.advance(run.now_ns)
        if sample is not None:
            assert (sample.stamp_ns - 5_000_000_000) % STEP_NS == 0
            assert 0 <= run.now_ns - sample.stamp_ns < STEP_NS
    deadline_ns = run.simulation.deadline_ns()
    assert deadline_ns is not None
    assert run.now_ns < deadline_ns <= run.now_ns + 2 * STEP_NS, "when its fastest sensor is due"


@pytest.mark.parametrize("armed", [False, True])
@pytest.mark.parametrize("begin_ns", [5_013_000_000, -7_123_456_789, 60_000_000])
def test_each_sensor_is_sampled_at_its_multiples(begin_ns: int, armed: bool) -> None:
    run = Run("uav")
    run.now_ns = begin_ns
    simulation = run.simulation
    run.go(0.2)
    run.samples.clear()
    simulation.on_arm(armed)
    for _ in range(2):
        end_ns = run.now_ns + 3_000_000_000
        while run.now_ns < end_ns:
            if (sample := simulation.advance(run.now_ns)) is not None:
                run.samples.append(sample)
            due_ns = simulation.deadline_ns()
            assert due_ns is not None
            run.now_ns = due_ns
        run.now_ns += 7_777_000_001
    imu_ns, gnss_ns = (50_000_000, 100_000_000) if armed else (200_000_000, 200_000_000)
    for sensor, period_ns in (("imu", imu_ns), ("gnss", gnss_ns), ("battery", 1_000_000_000)):
        stamps = [one.stamp_ns for one in run.samples if getattr(one, sensor) is not None]
        late = [stamp_ns for stamp_ns in stamps if stamp_ns % period_ns]
        assert len(late) <= 2, "only where a sample is caught up with"
        assert len(stamps) >= 5


@pytest.mark.parametrize("kind", ["ugv", "uav", "usv"])
def test_parked_vehicle_is_sampled_with_sensors_only(kind: str) -> None:
    run = Run(kind)
    simulation = run.simulation
    begin_ns = run.now_ns
    while run.now_ns < begin_ns + 10_000_000_000:
        sample = simulation.advance(run.now_ns)
        if sample is not None:
            run.samples.append(sample)
        due_ns = simulation.deadline_ns()
        assert due_ns is not None
        run.now_ns = due_ns
    assert len(run.samples) <= 51, "all its sensors are sampled together"
    for sensor, count in (("imu", 50), ("gnss", 50), ("scan", 50), ("battery", 10)):
        assert sum(getattr(one, sensor) is not None for one in run.samples) == pytest.approx(count, abs=2)
    simulation.on_arm(True)
    due_ns = simulation.deadline_ns()
    assert due_ns is not None
    assert due_ns <= run.now_ns + 2 * STEP_NS, "an armed one has its fastest sensor sampled with 20 Hz"


@pytest.mark.parametrize("kind", ["ugv", "uav", "usv"])
def test_moving_vehicle_wakes_at_shared_sensor_instants(kind: str) -> None:
    run = Run(kind)
    simulation = run.simulation
    simulation.advance(run.now_ns)
    simulation.on_arm(True)
    stamps = []
    while run.now_ns < 10_000_000_000:
        due_ns = simulation.deadline_ns()
        assert due_ns is not None
        run.now_ns = due_ns
        simulation.on_command(Setpoint(1.0, 0.0, 0.5), due_ns)
        sample = simulation.advance(run.now_ns)
        assert sample is not None
        stamps.append(sample.stamp_ns)
    assert len(stamps) == pytest.approx(5 * simulation.output_hz, abs=2)
    assert simulation.output_hz == 20
    assert all(stamp_ns % 50_000_000 == 0 for stamp_ns in stamps)


def test_flying_vehicle_without_motors_is_not_resting() -> None:
    run = Run("uav", start=Pose.planar(0.0, 0.0, 5.0))
    run.go(0.1)
    deadline_ns = run.simulation.deadline_ns()
    assert not run.simulation.state().armed
    assert deadline_ns is not None
    assert deadline_ns <= run.now_ns + 2 * STEP_NS


def test_set_points_with_each_sample_are_followed() -> None:
    run = Run()
    run.simulation.on_arm(True)
    run.go(3.0, Setpoint(1.0))
    assert run.samples[-1].truth.x_m > 1.5


def test_set_point_acts_from_its_own_instant() -> None:
    late, often = Run(), Run()
    for run, pause in ((late, 40), (often, 1)):
        run.go(0.1)
        run.simulation.on_arm(True)
        begin_ns = run.now_ns
        for step in range(1, 41):
            run.now_ns = begin_ns + step * STEP_NS
            if step == 20:
                run.simulation.on_command(Setpoint(1.0), run.now_ns)
            if step % pause == 0 and (sample := run.simulation.advance(run.now_ns)) is not None:
                run.samples.append(sample)
    assert often.samples[-1].truth.x_m > 0.1
    assert late.samples[-1].truth == often.samples[-1].truth


def test_parked_vehicle_moved_by_hand_is_simulated() -> None:
    run = Run("uav").go(1.0)
    simulation = run.simulation
    simulation.vehicle.stop_at(1.0, 2.0, 3.0)
    run.go(0.1)
    assert run.samples[-1].truth.x_m == 1.0


def test_before_its_first_call_it_waits_for_nothing() -> None:
    assert Run().simulation.deadline_ns() is None


def test_the_same_drive_however_the_calls_come() -> None:
    fine, coarse = Run(), Run()
    for run, step_ns in ((fine, STEP_NS), (coarse, 5 * STEP_NS)):
        run.simulation.on_arm(True)
        run.go(2.0, Setpoint(1.0, 0.0, 0.0, 0.3), step_ns)
    end = fine.samples[-1].truth
    assert coarse.samples[-1].truth.x_m == pytest.approx(end.x_m, abs=0.1)


def test_sensors_come_at_their_own_rates() -> None:
    run = Run("uav").go(0.1)
    run.simulation.on_arm(True)
    run.samples.clear()
    run.go(10.0)
    counts = [
        sum(getattr(s, name) is not None for s in run.samples)
        for name in ("gnss", "imu", "scan", "sonar", "battery")
    ]
    assert counts == [100, 200, 100, 200, 10]


def test_a_vehicle_that_drives_has_no_sonar() -> None:
    assert all(s.sonar is None for s in Run("ugv").go(1.0).samples)


def test_state_is_published_on_change_and_periodically() -> None:
    run = Run().go(0.1)
    run.simulation.on_arm(True)
    run.go(2.4)
    told = [s.report for s in run.samples if s.report is not None]
    assert [state.armed for state in told] == [False, True, True, True]


def test_empty_battery_refuses_to_arm_with_reason() -> None:
    run = Run(config=Config(battery=BatteryConfig(start_ratio=0.1)))
    with pytest.raises(Denied, match="battery at 10%, expected at least 15%"):
        run.simulation.on_arm(True)


def test_disarming_in_the_air_is_refused() -> None:
    run = Run("uav")
    run.simulation.on_arm(True)
    run.go(2.0, Setpoint(0.0, 0.0, 1.0))
    with pytest.raises(Denied, match="disarming in the air"):
        run.simulation.on_arm(False)


def test_motors_stop_when_the_battery_is_empty() -> None:
    run = Run("uav", Config(battery=BatteryConfig(capacity_wh=0.3, start_ratio=0.5)))
    run.simulation.on_arm(True)
    run.go(6.0, Setpoint(0.0, 0.0, 1.0))
    run.go(4.0)
    assert not run.simulation.state().armed
    assert run.simulation.state().landed
    assert GROUND in run.hits


def test_without_set_points_the_vehicle_stops() -> None:
    run = Run()
    run.simulation.on_arm(True)
    run.go(1.0, Setpoint(1.0)).go(1.5)
    assert run.samples[-1].truth.vx_m_s == 0.0


def test_obstacle_does_not_yield_and_is_reported() -> None:
    run = Run()
    run.simulation.on_arm(True)
    run.go(6.0, Setpoint(1.0))
    assert run.hits == ["boulder"]
    assert run.samples[-1].truth.x_m < 3.0 - 0.5 - 0.34
    hit = next(h for s in run.samples for h in s.collisions)
    assert hit.speed_m_s == pytest.approx(1.0)
    run.go(4.0, Setpoint(-0.5))
    assert run.samples[-1].truth.x_m < 1.0
    run.go(6.0, Setpoint(1.0))
    assert run.hits == ["boulder", "boulder"]


def test_vehicle_above_obstacle_does_not_touch_it() -> None:
    run = Run("uav", start=Pose.planar(0.0, 0.0, 2.0))
    run.simulation.vehicle.armed = True
    run.go(5.0, Setpoint(1.0))
    assert run.hits == []
    assert run.samples[-1].truth.x_m > 4.0


def test_leaving_the_world_is_told() -> None:
    run = Run(start=Pose.planar(19.0, 5.0))
    run.simulation.on_arm(True)
    assert run.go(3.0, Setpoint(1.0)).hits == [BOUNDS]


def test_touching_another_platform_is_told_once_per_contact() -> None:
    run = Run()
    run.go(0.1)
    other = Pose.planar(0.5, 0.0)
    for x in (0.5, 0.5, 5.0, 0.5):
        run.simulation.on_neighbour("ugv2", Pose.planar(x, 0.0), run.now_ns)
        run.go(0.3)
    assert run.hits == ["ugv2", "ugv2"]
    run.simulation.on_neighbour("ugv3", other, run.now_ns - 2_000_000_000)
    run.go(0.3)
    assert "ugv3" not in run.hits


def test_a_long_stall_is_not_simulated_afterwards() -> None:
    run = Run().go(1.0)
    run.now_ns += 60_000_000_000
    run.go(0.02)
    assert 0 <= run.now_ns - run.samples[-1].stamp_ns < STEP_NS


def test_kill_stops_motors_in_air_and_vehicle_falls() -> None:
    run = Run("uav")
    run.simulation.on_arm(True)
    run.go(4, Setpoint(0.0, 0.0, 1.5))
    assert not run.simulation.state().landed
    with pytest.raises(Denied, match="disarming in the air"):
        run.simulation.on_arm(False)
    state = run.simulation.on_kill()
    assert (state.armed, state.landed) == (False, False)
    with pytest.raises(Denied, match=r"arming in the air at .* expected a landed vehicle"):
        run.simulation.on_arm(True)
    run.go(5, Setpoint(0.0, 0.0, 1.5))
    assert run.simulation.state().landed
    assert GROUND in run.hits
    assert run.simulation.on_arm(True).armed


def test_a_kill_on_the_ground_disarms() -> None:
    run = Run("ugv")
    run.simulation.on_arm(True)
    assert run.simulation.on_kill() == run.simulation.state()
    assert not run.simulation.state().armed
