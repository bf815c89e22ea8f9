"""Readings of a sonar: units, pieces, garbage."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.devices.maxbotix import SonarDecoder, SonarUnit, reading


@pytest.mark.parametrize(
    ("unit", "line", "range_m"),
    [(SonarUnit.INCH, b"R060\r", 1.524), (SonarUnit.CM, b"R153\r", 1.53), (SonarUnit.MM, b"R1534\r", 1.534)],
)
def test_readings_of_each_model_are_metres(unit: SonarUnit, line: bytes, range_m: float) -> None:
    decoder = SonarDecoder(unit)
    assert list(decoder.feed(line[:2])) == []
    assert list(decoder.feed(line[2:])) == [pytest.approx(range_m)]
    assert reading(range_m, unit) == line
    assert decoder.valid == 1


def test_value_beyond_digits_is_their_maximum() -> None:
    assert reading(99.0, SonarUnit.MM) == b"R9999\r"
    assert reading(-1.0, SonarUnit.CM) == b"R000\r"


@given(st.lists(st.binary(max_size=300), max_size=8))
def test_reading_is_found_after_any_noise(
    chunks: list[bytes],
) -> None:
    decoder = SonarDecoder(SonarUnit.MM)
    for chunk in chunks:
        for found in decoder.feed(chunk):
            assert 0 <= found < 10
        assert len(decoder._line) <= 7
    list(decoder.feed(b"\r"))
    assert list(decoder.feed(b"R1000\r")) == [1.0]


@pytest.mark.parametrize("line", [b"R12345\r", b"R123\r", b"1234\r", b"Rabcd\r", b"R\xff\xff\xff\xff\r"])
def test_other_lines_are_refused_by_name(line: bytes) -> None:
    decoder = SonarDecoder(SonarUnit.MM)
    assert list(decoder.feed(line)) == []
    assert decoder.refused == {"no reading: expected R and 4 digits": 1}
