"""One environment variable names the configuration folder for daemons, commands and modules."""

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest

import swarmctl.main
import swarmd.main
from swarmctl.commandline.settings import CliSettings
from swarmctl.session.session import config_dir
from swarmware import Module
from swarmware.errors import ConfigError, NotFound
from swarmware.testing.tmpnode import make_node


def by_module(*_: str) -> int:
    async def join() -> None:
        async with Module("test"):
            pass

    try:
        asyncio.run(join())
    except ConfigError as error:
        import sys

        print(error, file=sys.stderr)
        return error.exit_code
    return 0


def by_swarmd(*options: str) -> int:
    return swarmd.main.main(["node", *options])


def by_swarmctl(*options: str) -> int:
    return swarmctl.main.main(["node", "ls", *options])


EVERYBODY = [by_module, by_swarmd, by_swarmctl]


@pytest.fixture(autouse=True)
def environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("SWARM_CONFIG", "SWARMCTL_CONFIG", "SWARMD_CONFIG", "SWARMCTL_LAB"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("SWARMCTL_LABS", str(tmp_path / "labs"))


@pytest.mark.parametrize("start", EVERYBODY)
def test_swarm_config_names_the_folder_for_everybody(
    start: Callable[..., int],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("SWARM_CONFIG", str(tmp_path / "mine"))
    assert start() == ConfigError.exit_code
    assert f"{tmp_path / 'mine' / 'node.toml'}: no such file" in capsys.readouterr().err


@pytest.mark.parametrize("start", [by_swarmd, by_swarmctl])
def test_the_option_goes_before_the_variable(
    start: Callable[..., int],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("SWARM_CONFIG", str(tmp_path / "variable"))
    assert start("--config", str(tmp_path / "option")) == ConfigError.exit_code
    assert str(tmp_path / "option") in capsys.readouterr().err


@pytest.mark.parametrize("start", EVERYBODY)
@pytest.mark.parametrize("variable", ["SWARMCTL_CONFIG", "SWARMD_CONFIG"])
def test_there_is_no_second_variable(
    variable: str,
    start: Callable[..., int],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("swarmware.model.config.DEFAULT_DIR", tmp_path / "usual")
    monkeypatch.setattr("swarmctl.session.session.DEFAULT_DIR", tmp_path / "usual")
    monkeypatch.setenv(variable, str(tmp_path / "other"))
    assert start() != 0
    error = capsys.readouterr().err
    assert str(tmp_path / "usual") in error
    assert str(tmp_path / "other") not in error


def test_lab_that_is_named_goes_before_variable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SWARM_CONFIG", str(tmp_path))
    assert config_dir(CliSettings()) == tmp_path
    with pytest.raises(NotFound, match="field"):
        config_dir(CliSettings(lab="field"))


def test_swarmd_names_units_of_services_in_node_toml(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_node(tmp_path, services={"broker": {}, "temp-sensor": {}})
    monkeypatch.setenv("SWARM_CONFIG", str(folder))
    assert swarmd.main.main(["units"]) == 0
    assert capsys.readouterr().out == "swarmd@broker.service\nswarmd@temp-sensor.service\n"
