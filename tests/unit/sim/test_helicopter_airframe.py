"""The helicopter's airframe file, its rotors as a model, and its directions in body axes (FLU)."""

import pytest
from tests.unit.airframes import artis
from tests.unit.sim.hover import PUBLISHED, R50_RADIUS_M, R50_TIP_M_S, froude, scale

from swarmd.sim.core.helicopter_airframe import HelicopterRotors
from swarmd.sim.core.rigid_body import RigidBody
from swarmware.geometry.attitude import Vector
from swarmware.geometry.geodesy import GRAVITY_M_S2
from swarmware.types.chassis import ActuatorOutputs

STILL = (0.0, 0.0, 0.0)
DT = 0.0025


AIRFRAME = artis()
WEIGHT_N = AIRFRAME.body.mass_kg * GRAVITY_M_S2


class Hung:
    """Rotors on a body that is held in the air."""

    def __init__(self) -> None:
        self.rotors = HelicopterRotors(AIRFRAME)
        self.body = RigidBody(AIRFRAME.body.mass_kg, AIRFRAME.body.inertia_kg_m2, (0.0, 0.0, 20.0), 0.0)

    def run(
        self, servos: tuple[float, ...], seconds: float, motor: float = 1.0, air: Vector = STILL
    ) -> tuple[Vector, Vector]:
        for _ in range(round(seconds / DT)):
            found = self.rotors.loads(ActuatorOutputs((motor,), servos), self.body, air, DT)
        return found


def test_file_derivatives_scale_published_ones() -> None:
    wanted = froude(AIRFRAME.body.mass_kg)
    for name in PUBLISHED:
        assert getattr(AIRFRAME.derivatives, name) == pytest.approx(getattr(wanted, name), rel=2e-3), name
    n = scale(AIRFRAME.body.mass_kg)
    assert AIRFRAME.rotor.radius_m == pytest.approx(R50_RADIUS_M / n, rel=2e-3)
    assert AIRFRAME.rotor.tip_speed_m_s == pytest.approx(R50_TIP_M_S / n**0.5, rel=2e-3)


def test_collective_that_controller_computes_carries_weight() -> None:
    hover = AIRFRAME.collective(WEIGHT_N)
    force, _ = Hung().run((0.0, 0.0, hover, 0.0), 8.0)
    assert force[2] == pytest.approx(WEIGHT_N, rel=0.02)


@pytest.mark.parametrize(
    ("servo", "axis"), [(0, 0), (1, 1), (3, 2)], ids=["roll right", "nose down", "nose left"]
)
def test_servos_turn_about_forward_left_and_up(servo: int, axis: int) -> None:
    def moment(position: float) -> float:
        servos = [0.0, 0.0, AIRFRAME.collective(WEIGHT_N), 0.0]
        servos[servo] = position
        return Hung().run(tuple(servos), 8.0)[1][axis]

    assert moment(0.1) > moment(0.0) + 0.5
    assert moment(-0.1) < moment(0.0) - 0.5


def test_a_disc_that_tilts_forward_pulls_forward() -> None:
    force, moment = Hung().run((0.0, 0.2, AIRFRAME.collective(WEIGHT_N), 0.0), 8.0)
    assert force[0] > 1.0 and moment[1] > 0.0


def test_wind_from_ahead_pushes_back_and_lifts_nose() -> None:
    hover = (0.0, 0.0, AIRFRAME.collective(WEIGHT_N), 0.0)
    force, moment = Hung().run(hover, 8.0, air=(5.0, 0.0, 0.0))
    assert force[0] < -1.0
    assert moment[1] > 0.0, "m_u of the source: the nose goes down with forward speed"


def test_rotor_turns_slowly_and_lifts_only_spinning() -> None:
    hung = Hung()
    hover = (0.0, 0.0, AIRFRAME.collective(WEIGHT_N), 0.0)
    early, _ = hung.run(hover, 0.3)
    late, _ = hung.run(hover, 8.0)
    assert early[2] < 0.3 * late[2]
    off, moment = hung.run((), 10.0, motor=0.0)
    assert off == pytest.approx(STILL, abs=1.0)
    assert moment == pytest.approx(STILL, abs=0.1)
    assert hung.rotors.power_w() == pytest.approx(AIRFRAME.idle_w, abs=1.0)


def test_hover_power_is_momentum_plus_blades() -> None:
    hung = Hung()
    hung.run((0.0, 0.0, AIRFRAME.collective(WEIGHT_N), 0.0), 8.0)
    ideal_w = WEIGHT_N * 4.02
    assert ideal_w < AIRFRAME.efficiency_ratio * hung.rotors.power_w() < 2.5 * ideal_w
