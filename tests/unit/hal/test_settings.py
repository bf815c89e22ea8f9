"""The shipped settings of sim, navigator and hal pass their own checks; defaults alone are never checked."""

from pathlib import Path

import msgspec
import pytest

from swarmd.hal.config import Config as HalConfig
from swarmd.navigator.config import Config as NavigatorConfig
from swarmd.sim.config import Config as SimConfig
from swarmware.errors import ConfigError
from swarmware.model.config import load, parse

SERVICES = Path(__file__).parents[3] / "etc/swarm/services"


@pytest.mark.parametrize(
    ("name", "cls"), [("sim", SimConfig), ("navigator", NavigatorConfig), ("hal", HalConfig)]
)
def test_shipped_file_is_accepted_and_equals_defaults(name: str, cls: type[msgspec.Struct]) -> None:
    assert load(SERVICES / f"{name}.toml", cls) == cls()


@pytest.mark.parametrize(
    ("cls", "text", "complaint"),
    [
        (SimConfig, "rate_hz = 5.0", r"key rate_hz: expected `float` >= 10.0 \(it is 5.0\)"),
        (SimConfig, "[sensors]\ngnss = 1.0", "key sensors.gnss: unknown; did you mean gnss_hz"),
        (NavigatorConfig, "[dwa]\nheading_weight = -1.0", "key dwa.heading_weight"),
        (HalConfig, 'drivers = "sim"', "key drivers"),
    ],
)
def test_a_mistake_is_named_by_its_key(cls: type[msgspec.Struct], text: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        parse(text, cls, "some.toml")
