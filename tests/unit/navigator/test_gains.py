"""Gains change while the vehicle moves (S2.46): names, tables and the templates belong together."""

from pathlib import Path

import pytest

from swarmd.navigator.config import Config
from swarmd.navigator.core.altitude import AltitudeHold
from swarmd.navigator.service import GAINS, controller, with_gains
from swarmware.model.platform_kind import PlatformKind
from swarmware.model.resource import Kind
from swarmware.model.template import load

TEMPLATES = Path(__file__).parents[3] / "share/swarm/templates"
PREFIX = "config/navigator/"


@pytest.mark.parametrize("name", ["ugv", "multirotor"])
def test_each_setting_of_a_template_is_a_gain_with_the_same_default(name: str) -> None:
    settings = [
        r for r in load(name, TEMPLATES).resources if r.path.startswith(PREFIX) and r.kind is Kind.SETTING
    ]
    assert settings
    for resource in settings:
        table, key = GAINS[resource.path.removeprefix(PREFIX)]
        assert getattr(getattr(Config(), table), key) == resource.default
        assert resource.writable


def test_every_gain_is_a_setting_of_some_template() -> None:
    offered = {
        r.path.removeprefix(PREFIX) for name in ("ugv", "multirotor") for r in load(name, TEMPLATES).resources
    }
    assert set(GAINS) <= offered


def test_gains_replace_only_what_they_name() -> None:
    changed = with_gains(Config(), {"altitude_kp": 3.0, "heading_weight": 0.5})
    assert changed.altitude.kp_1_s == 3.0
    assert changed.dwa.heading_weight == 0.5
    assert changed.altitude.ki_1_s2 == Config().altitude.ki_1_s2
    assert with_gains(Config(), {}) == Config()


def test_new_gains_work_at_once() -> None:
    hover = AltitudeHold(Config().altitude)
    before = hover.climb_m_s(1.0, 0.0, 0.0, 9.0, -9.0, 0.0)
    hover.set_gains(with_gains(Config(), {"altitude_kp": 2.4}).altitude)
    assert hover.climb_m_s(1.0, 0.0, 0.0, 9.0, -9.0, 0.0) == pytest.approx(2 * before)


@pytest.mark.parametrize(("kind", "flies"), [("uav", True), ("ugv", False), ("usv", False)])
def test_the_kind_of_platform_chooses_the_controller(kind: str, flies: bool) -> None:
    assert controller(PlatformKind(kind), Config()).flies is flies
