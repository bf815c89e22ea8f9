"""Configuration files: what is wrong is named by file, key and expectation."""

import contextlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import ConfigError
from swarmware.model import config


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('serwices = ["a"]', r"node.toml: line 1: key serwices: unknown; did you mean services\?"),
        ("[clock]\nzzz = 1", r"line 2: key clock.zzz: unknown; expected one of offset_s, drift_ppm"),
        ('[clock]\noffset_s = "x"', r"key clock.offset_s: expected `float`, got `str` \(it is 'x'\)"),
        ("[clock]\noffset_s = 1e9", r"key clock.offset_s: .*<= 3600.* \(it is 1000000000.0\)"),
        ('services = ["a", 3]', r"node.toml: line 1: key services\[1\]: expected `str`"),
        ('services = ["a", "a"]', "services: a name is listed twice"),
        (f'run_dir = "/{"a" * 88}"', "run_dir: 89 bytes; expected at most 88"),
        ('kind = "boat"', r"key kind: invalid enum value 'boat'"),
        ('kind = "ugv"\nairframe = "quad_1k5"', r"key airframe: 'quad_1k5' of a ugv; expected kind uav"),
        ('platform = "UAV"', r"node.toml: .*platform name 'UAV'"),
        ("\nx =", r"node.toml: line 2: invalid TOML"),
        ("clock = 3", r"line 1: key clock: expected `object`, got `int` \(it is 3\)"),
    ],
)
def test_error_names_file_line_key_and_expectation(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        config.parse(text, config.NodeConfig, "node.toml")


def test_a_missing_file_says_what_was_expected_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"node\.toml: no such file; expected a NodeConfig in TOML"):
        config.load_node(tmp_path)


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "node.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="cannot be read"):
        config.load_node(tmp_path)


def test_a_service_without_a_file_has_its_defaults(tmp_path: Path) -> None:
    assert config.load_service(tmp_path, "clock", config.ClockConfig) == config.ClockConfig()


def test_directories_follow_the_platform_unless_they_are_given() -> None:
    node = config.parse('platform = "ugv7"', config.NodeConfig, "node.toml")
    assert node.shm_path == Path("/dev/shm/swarm-ugv7")
    assert config.parse('shm_dir = "/x"', config.NodeConfig, "node.toml").shm_path == Path("/x")


def test_the_share_directory_of_this_checkout_is_found() -> None:
    assert (config.share_dir() / "templates").is_dir()


@given(st.text(max_size=60))
def test_any_text_is_configuration_or_config_error(text: str) -> None:
    with contextlib.suppress(ConfigError):
        assert isinstance(config.parse(text, config.NodeConfig, "node.toml"), config.NodeConfig)


@pytest.mark.parametrize(
    ("services", "message"),
    [
        ('["a-b", "a_b"]', "have the same resource paths"),
        ('["a", "a"]', "twice"),
        ('["../a"]', "application name"),
        ('["A"]', "application name"),
    ],
)
def test_names_of_services_are_checked(services: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        config.parse(f"services = {services}", config.NodeConfig, "node.toml")
    assert config.parse('services = ["a-b", "ab"]', config.NodeConfig, "node.toml").services == ("a-b", "ab")


def test_misspelt_service_settings_are_not_ignored(tmp_path: Path) -> None:
    (tmp_path / "services").mkdir()
    (tmp_path / "services" / "temp_sensor.toml").write_text("")
    with pytest.raises(
        ConfigError, match=r"temp_sensor\.toml: not the name of a service.*in temp-sensor\.toml"
    ):
        config.load_service(tmp_path, "temp-sensor", config.NodeConfig)
