"""A live setting overrides its file only when it was changed, at the start of a service and while it runs."""

import logging
from pathlib import Path
from typing import Annotated

import msgspec
import pytest

from swarmware.model.resource import Kind, Resource
from swarmware.module.module import Module
from swarmware.service.live_config import LiveConfig, overridden, value_at, with_value
from swarmware.testing.tmpnode import tmp_node
from swarmware.types.scalar import Float, Text


class Hold(msgspec.Struct, frozen=True, kw_only=True):
    kp_1_s: Annotated[float, msgspec.Meta(ge=0, le=100)] = 1.2


class Config(msgspec.Struct, frozen=True, kw_only=True):
    mode: str = "auto"
    hold: Hold = Hold()


LIVE = {"hold.kp_1_s": "pilot/kp", "mode": "pilot/mode"}
FILE = Config(hold=Hold(kp_1_s=1.5))


def test_a_dotted_key_names_one_value() -> None:
    changed = with_value(with_value(FILE, "hold.kp_1_s", 3.0), "mode", "manual")
    assert changed == Config(mode="manual", hold=Hold(kp_1_s=3.0))
    assert (value_at(changed, "hold.kp_1_s"), value_at(changed, "mode")) == (3.0, "manual")


@pytest.mark.parametrize(
    ("stored", "expected"),
    [
        (None, FILE),
        ('["config/pilot/kp"]\nvalue = 2.5\nversion = 1\n', Config(hold=Hold(kp_1_s=2.5))),
        ('["config/pilot/kp"]\nvalue = 3\nversion = 1\n', Config(hold=Hold(kp_1_s=3.0))),
        ('["config/pilot/kp"]\nversion = 2\n', FILE),
        ('["config/pilot/kp"]\nvalue = 101.0\nversion = 1\n', FILE),
        ('["config/pilot/kp"]\nvalue = "much"\nversion = 1\n', FILE),
        ('["config/other/kp"]\nvalue = 2.5\nversion = 1\n', FILE),
        ("nonsense [", FILE),
        ("a = 1", FILE),
    ],
)
def test_service_starts_with_file_and_fitting_overrides(
    tmp_path: Path, stored: str | None, expected: Config
) -> None:
    if stored is not None:
        (tmp_path / "settings.toml").write_text(stored)
    assert overridden(FILE, LIVE, tmp_path) == expected


def test_unfitting_override_is_named_in_log(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "settings.toml").write_text('["config/pilot/kp"]\nvalue = 101.0\nversion = 1\n')
    with caplog.at_level(logging.WARNING):
        overridden(FILE, LIVE, tmp_path)
    assert "pilot/kp is invalid" in caplog.text
    assert "<= 100" in caplog.text


async def test_only_value_that_was_written_after_join_overrides(tmp_path: Path) -> None:
    async with tmp_node(tmp_path) as node, Module("keeper", node=node) as keeper:
        boards = {
            name: keeper.writer(
                Resource(path=f"config/pilot/{name}", kind=Kind.SETTING, type=cls.__name__, default=default),
                cls,
            )
            for name, cls, default in (("kp", Float, 1.2), ("mode", Text, "auto"))
        }
        boards["kp"].write(Float(1.2))
        boards["mode"].write(Text("auto"))
        async with Module("pilot", node=node, config=FILE, live_settings=LIVE) as pilot:
            assert pilot.entry.live == LIVE
            live = LiveConfig(pilot, FILE, LIVE)
            assert live.take() is None, "it may come from a file that has changed since"
            boards["kp"].write(Float(1.5))
            assert live.take() is None, "the value of the file"
            boards["kp"].write(Float(4.0))
            assert live.take() == Config(hold=Hold(kp_1_s=4.0))
            assert live.take() is None
            boards["mode"].write(Text("manual"))
            assert live.take() == Config(mode="manual", hold=Hold(kp_1_s=4.0))
