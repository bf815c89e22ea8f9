"""The file channels.toml: typed, checked with file and line, and the shipped one."""

from pathlib import Path

import pytest

from swarmware.errors import ConfigError
from swarmware.service.channels import FILE, load_channels
from swarmware.types.channel import ChannelPriority, ChannelProtocol, ChannelSettings, settings_of

ROOT = Path(__file__).parents[3]
WHOLE = """
[[channel]]
pattern = "sensor/lidar/**"
link = "gcs"
max_hz = 5
compression = "zstd:1"
buffer_bytes = 2_000_000
buffer_s = 30.0
priority = "low"

[[channel]]
pattern = "power/*"
protocol = "udp"
"""


def written(folder: Path, text: str) -> Path:
    (folder / FILE).write_text(text)
    return folder


def test_without_a_file_there_is_no_rule(tmp_path: Path) -> None:
    assert load_channels(tmp_path) == ()


def test_all_settings_are_read(tmp_path: Path) -> None:
    rules = load_channels(written(tmp_path, WHOLE))
    assert settings_of(rules, "sensor/lidar/packets", "gcs") == ChannelSettings(
        5.0, None, "zstd:1", 2_000_000, 30.0, ChannelPriority.LOW
    )
    assert settings_of(rules, "power/battery").protocol == ChannelProtocol.UDP
    assert all(rule.from_file for rule in rules)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ('compression = "lzma"', "lzma"),
        ("max_hz = -1", "max_hz -1"),
        ('protocol = "rtp"', "expected link"),
        ("buffer_s = 0", "buffer_s 0"),
        ('rate = "5hz"', "rate"),
        ("", "expected a setting"),
        ('priority = "top"', "top"),
        ('link = "Not a name"\nmax_hz = 1', "Not a name"),
    ],
)
def test_each_error_names_file_and_line(tmp_path: Path, line: str, reason: str) -> None:
    text = f'[[channel]]\npattern = "a"\nmax_hz = 1\n\n[[channel]]\npattern = "nav/*"\n{line}\n'
    with pytest.raises(ConfigError, match=reason) as found:
        load_channels(written(tmp_path, text))
    assert FILE in str(found.value)
    assert any(f"line {number}:" in str(found.value) for number in (5, 6, 7))


@pytest.mark.parametrize(("line", "rate"), [("", "auto"), ("max_hz = 30", "auto:30hz")])
def test_rate_may_follow_link_with_limit_or_without(tmp_path: Path, line: str, rate: str) -> None:
    text = f'[[channel]]\npattern = "map/*"\nadaptive = true\n{line}\n'
    [rule] = load_channels(written(tmp_path, text))
    assert rule.settings.rate == rate


def test_the_shipped_file_loads_and_changes_nothing() -> None:
    assert load_channels(ROOT / "etc" / "swarm") == ()
