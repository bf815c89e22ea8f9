"""Gains change while the vehicle moves (S2.46): names, tables and the templates belong together."""

from pathlib import Path

import pytest

from swarmd.navigator.config import Config
from swarmd.navigator.core.air_controller import AltitudeHold
from swarmd.navigator.core.controller import controller
from swarmd.navigator.service import Navigator
from swarmware.model.airframe_file import load_airframe
from swarmware.model.config import parse
from swarmware.model.platform_kind import PlatformKind
from swarmware.model.resource import Kind
from swarmware.model.template import load
from swarmware.service.live_config import value_at, with_value

SHARE = Path(__file__).parents[3] / "share/swarm"
TEMPLATES = SHARE / "templates"
PREFIX = "config/navigator/"
KEYS = {f"config/{name}": key for key, name in Navigator.live_settings.items()}
"""Keys of the file, by the paths of their settings."""


@pytest.mark.parametrize("name", ["ugv", "multirotor"])
def test_template_setting_is_gain_with_same_default(name: str) -> None:
    settings = [
        r for r in load(name, TEMPLATES).resources if r.path.startswith(PREFIX) and r.kind is Kind.SETTING
    ]
    assert settings
    for resource in settings:
        key = KEYS[resource.path]
        assert value_at(Config(), key) == resource.default
        assert resource.writable
        assert resource.range is not None
        for bound in resource.range:  # the service takes each value that the tree takes
            assert value_at(parse(f"{key} = {bound}", Config, "bound"), key) == bound


def test_every_gain_is_a_setting_of_some_template() -> None:
    offered = {r.path for name in ("ugv", "multirotor") for r in load(name, TEMPLATES).resources}
    assert set(KEYS) <= offered


def test_new_gains_work_at_once() -> None:
    hover = AltitudeHold(Config().altitude)
    before = hover.climb_m_s(1.0, 0.0, 0.0, 9.0, -9.0, 0.0)
    hover.set_gains(with_value(Config(), "altitude.kp_1_s", 2.4).altitude)
    assert hover.climb_m_s(1.0, 0.0, 0.0, 9.0, -9.0, 0.0) == pytest.approx(2 * before)


@pytest.mark.parametrize(("kind", "flies"), [("uav", True), ("ugv", False), ("usv", False)])
def test_the_kind_of_platform_chooses_the_controller(kind: str, flies: bool) -> None:
    found = controller(PlatformKind(kind), Config())
    assert (found.flies, found.circle_m) == (flies, 0.0)


@pytest.mark.parametrize(("airframe", "circles"), [("fixed_wing", True), ("helicopter", False)])
def test_airframe_that_cannot_stop_gets_controller_that_circles(airframe: str, circles: bool) -> None:
    found = controller(PlatformKind.UAV, Config(), load_airframe(SHARE, airframe))
    assert (found.circle_m > 0.0) is circles
