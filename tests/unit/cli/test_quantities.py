"""Rates, spans and instants as people type and read them."""

import pytest

from swarmctl.commandline.settings import CliSettings
from swarmctl.commands.log.entries import absolute, instant_ns
from swarmctl.terminal.quantities import bit_rate_bytes_s, rate_hz, size_bytes, span_s, spoken, utc_text
from swarmware.errors import InvalidInput

NOW_NS = 1_795_244_000_000_000_000


@pytest.mark.parametrize(
    ("text", "value"),
    [("200ms", 0.2), ("30s", 30.0), ("1.5m", 90.0), ("2h", 7200.0), ("1d", 86400.0), ("0s", 0.0)],
)
def test_a_span_has_a_number_and_a_unit(text: str, value: float) -> None:
    assert span_s(text) == pytest.approx(value)


@pytest.mark.parametrize("text", ["", "5", "s", "-5s", "5 s", "5S", "5s\n", "1e3s", "5s5s", "٣s x"])
def test_anything_else_is_no_span(text: str) -> None:
    with pytest.raises(InvalidInput, match="expected 200ms"):
        span_s(text)


@pytest.mark.parametrize(("text", "value"), [("5hz", 5.0), ("0.5Hz", 0.5), ("0hz", 0.0)])
def test_a_rate_is_hertz(text: str, value: float) -> None:
    assert rate_hz(text) == value


@pytest.mark.parametrize(
    ("text", "value"),
    [("500B", 500), ("64kB", 64_000), ("2MB", 2_000_000), ("1.5KiB", 1536), ("1MiB", 1_048_576)],
)
def test_a_size_has_a_number_and_a_unit(text: str, value: int) -> None:
    assert size_bytes(text) == value


@pytest.mark.parametrize(
    ("text", "value"), [("250kbit", 31_250.0), ("5Mbit", 625_000.0), ("0.5gbit", 62_500_000.0)]
)
def test_the_rate_of_a_link_is_in_bits(text: str, value: float) -> None:
    assert bit_rate_bytes_s(text) == value


@pytest.mark.parametrize("text", ["", "5", "5mb", "0mbit", "-1mbit"])
def test_anything_else_is_no_rate_of_a_link(text: str) -> None:
    with pytest.raises(InvalidInput, match="expected 250kbit"):
        bit_rate_bytes_s(text)


@pytest.mark.parametrize("text", ["", "5", "MB", "-5MB", "5 MB", "5GB", "5mb"])
def test_anything_else_is_no_size(text: str) -> None:
    with pytest.raises(InvalidInput, match="expected 500B"):
        size_bytes(text)


@pytest.mark.parametrize("text", ["", "5", "fast", "auto", "-1hz", "5khz", "5 hz"])
def test_anything_else_is_no_rate(text: str) -> None:
    with pytest.raises(InvalidInput, match="expected 5hz"):
        rate_hz(text)


@pytest.mark.parametrize(
    ("span", "text"),
    [
        (0.04, "0.0s"),
        (9.94, "9.9s"),
        (42.4, "42s"),
        (59.9, "1m00s"),
        (229, "3m49s"),
        (3599.9, "1h00m"),
        (7500, "2h05m"),
        (273_600, "3d04h"),
    ],
)
def test_span_is_spoken_in_two_units_at_most(span: float, text: str) -> None:
    # rounding up must not give 60 seconds or 60 minutes
    assert spoken(span) == text


@pytest.mark.parametrize(
    ("text", "utc_ns"),
    [
        ("30s", NOW_NS - 30_000_000_000),
        ("5m ago", NOW_NS - 300_000_000_000),
        ("200ms", NOW_NS - 200_000_000),
        ("1970-01-01T00:00:01Z", 1_000_000_000),
        ("1970-01-01T00:00:01", 1_000_000_000),
        ("1970-01-01T01:00:00+01:00", 0),
        ("1970-01-02", 86_400_000_000_000),
    ],
)
def test_instant_is_relative_or_date_in_utc(text: str, utc_ns: int) -> None:
    assert instant_ns(text, NOW_NS) == utc_ns


@pytest.mark.parametrize("text", ["", "yesterday", "5", "2026-13-01", "-5s"])
def test_anything_else_is_no_instant(text: str) -> None:
    with pytest.raises(InvalidInput, match="expected 30s"):
        instant_ns(text, NOW_NS)


def test_instant_is_written_as_it_can_be_typed() -> None:
    assert utc_text(1_500_000_000) == "1970-01-01T00:00:01.500Z"
    assert instant_ns(utc_text(1_500_000_000), NOW_NS) == 1_500_000_000


def test_pattern_without_platform_means_asked_or_all() -> None:
    assert absolute("nav/*", CliSettings()) == "/*/nav/*"
    assert absolute("nav/*", CliSettings(node="uav1")) == "/uav1/nav/*"
    assert absolute("/ugv1/nav/*", CliSettings(node="uav1")) == "/ugv1/nav/*"
