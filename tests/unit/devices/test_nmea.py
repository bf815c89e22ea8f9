"""Sentences of receivers become fixes; damaged and foreign ones are refused, counted, and named."""

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from tests.unit.devices.receivers import CLASSIC, RMC, SOUTH, sentence

from swarmware.devices.gnss_receiver import LINE_BYTES, ReceiverDecoder
from swarmware.devices.nmea import fix_sentences
from swarmware.types import registry
from swarmware.types.vehicle import GnssFix


def test_fixes_of_real_receivers() -> None:
    decoder = ReceiverDecoder()
    (fix,) = decoder.feed(CLASSIC)
    assert fix.lat_deg == pytest.approx(48 + 7.038 / 60)
    assert fix.lon_deg == pytest.approx(11 + 31 / 60)
    assert fix.alt_ellipsoid_m == pytest.approx(592.3), "above the ellipsoid, not above the sea"
    assert (fix.satellites, fix.h_acc_m) == (8, 4.5)
    (fix,) = decoder.feed(sentence(SOUTH))
    assert fix.lat_deg == pytest.approx(-(33 + 34.2313457 / 60))
    assert fix.lon_deg == pytest.approx(-(112 + 11.0576940 / 60))
    assert fix.h_acc_m == 5.4
    assert not decoder.refused


def test_sentence_may_come_in_any_pieces_between_others() -> None:
    line = RMC + CLASSIC + b"\r\n" + RMC + sentence(SOUTH)
    for size in (1, 2, 7, 200):
        decoder = ReceiverDecoder()
        fixes = [fix for at in range(0, len(line), size) for fix in decoder.feed(line[at : at + size])]
        assert len(fixes) == 2
        assert decoder.valid == 4


def test_fresh_accuracy_of_receiver_is_preferred() -> None:
    decoder = ReceiverDecoder()
    list(decoder.feed(sentence("GPGST,001037.00,1.2,1.0,0.5,30.0,0.03,0.04,0.10")))
    (fix,) = decoder.feed(sentence(SOUTH))
    assert fix.h_acc_m == 0.05
    (fix,) = decoder.feed(sentence(SOUTH.replace("001038", "001138")))
    assert fix.h_acc_m == 5.4


@pytest.mark.parametrize("quality", ["0", "6", "7", "8", ""])
def test_missing_position_gives_neither_fix_nor_error(quality: str) -> None:
    decoder = ReceiverDecoder()
    assert list(decoder.feed(sentence(f"GPGGA,,,,,,{quality},00,99.9,,,,,,"))) == []
    assert decoder.valid == 1
    assert not decoder.refused
    assert decoder.reason == f"GGA: no fix (quality {quality or 'empty'})"


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (CLASSIC.replace(b"*47", b"*48"), "checksum wrong"),
        (CLASSIC.replace(b"*47", b"*4"), "checksum or text invalid"),
        (CLASSIC.replace(b"*47", b"*+7"), "checksum or text invalid"),
        (CLASSIC.replace(b"4807", b"48\xff7"), "no sentence: expected $…*checksum"),
        (b"4807.038,N\r\n", "no sentence: expected $…*checksum"),
        (b"$" + b"A" * LINE_BYTES + b"\r\n", f"longer than {LINE_BYTES} bytes"),
        (sentence(SOUTH + ",1"), "GGA of 16 fields, expected 15"),
        (sentence(SOUTH.replace("3334.2313457", "3360.0")), "position out of range"),
        (sentence(SOUTH.replace("3334.2313457", "9034.0")), "position out of range"),
        (sentence(SOUTH.replace(",S,", ",Q,")), "position out of range"),
        (sentence(SOUTH.replace("354.682", "--3")), "height: no number"),
        (sentence(SOUTH.replace("354.682", "1e5")), "height: no number"),
        (sentence(SOUTH.replace(",04,", ",99999,")), "satellites out of range"),
        (sentence(SOUTH.replace("001038.00", "241038.00")), "time: expected hhmmss.ss"),
        (sentence(SOUTH.replace(",04,", ",00,")), "GGA: a fix without satellites"),
        (sentence(SOUTH.replace(",354.682,M,", ",1163.66,F,")), "GGA: unit of the height is F; expected M"),
        (sentence(SOUTH.replace(",-26.574,M,", ",-26.574,,")), "GGA: unit of the geoid is empty; expected M"),
        (sentence(SOUTH.replace(",5.4,", ",-5.4,")), "dilution out of range"),
        (sentence("GPGST,1,2"), "GST of 3 fields, expected 9"),
        (sentence("GNGNS,1,2"), "GNS of 3 fields, expected 13 to 14"),
    ],
)
def test_unknown_sentence_is_named_and_fix_follows(line: bytes, reason: str) -> None:
    decoder = ReceiverDecoder()
    assert list(decoder.feed(line)) == []
    assert decoder.refused == {reason: 1}
    assert len(list(decoder.feed(CLASSIC))) == 1


@given(st.lists(st.text("0123456789.-NSEW", max_size=12), min_size=14, max_size=14))
def test_any_checksummed_fields_are_fix_or_refused(fields: list[str]) -> None:
    for fix in ReceiverDecoder().feed(sentence(f"GPGGA,{','.join(fields)}")):
        assert -90 <= fix.lat_deg <= 90
        assert -180 <= fix.lon_deg <= 180
        assert repr(registry.decode(GnssFix, registry.encode(fix))) == repr(fix), "a height may be NaN"
        assert fix.sigma_m >= 0.01


@given(
    st.floats(-90, 90),
    st.floats(-180, 180),
    st.floats(-400, 9000),
    st.floats(0.01, 50),
    st.integers(1, 99),
    st.floats(0, 1e6),
)
def test_sentences_of_fix_are_read_as_this_fix(
    lat: float, lon: float, height: float, accuracy: float, satellites: int, time_s: float
) -> None:
    assume(abs(lat) > 1e-8 or abs(lon) > 1e-8)
    decoder = ReceiverDecoder()
    (found,) = decoder.feed(fix_sentences(GnssFix(lat, lon, height, accuracy, satellites), time_s))
    assert not decoder.refused
    assert found.lat_deg == pytest.approx(lat, abs=2e-9)
    assert found.lon_deg == pytest.approx(lon, abs=2e-9)
    assert found.alt_ellipsoid_m == pytest.approx(height, abs=1e-3)
    assert found.h_acc_m == pytest.approx(accuracy, abs=1e-3)
    assert found.satellites == satellites
