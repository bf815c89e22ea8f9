"""Bytes of receivers: sentences and frames between noise, of all kinds with a position."""

import math
import random
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.devices.receivers import CLASSIC, RMC, SOUTH, UBLOX, pvt, sentence

from swarmware.devices import ubx
from swarmware.devices.gnss_receiver import NO_SENTENCE, ReceiverDecoder
from swarmware.types.vehicle import GnssFix

DATA = Path(__file__).parents[2] / "data"
PVT = ubx.frame(ubx.NAV_PVT, pvt())
SAT = ubx.frame((0x01, 0x35), bytes(range(256)) * 2)
"""A frame without a position, whose payload has starts of sentences and frames."""
RTCM = b"\xd3\x00\x13" + bytes.fromhex("3ed7d30202980edeef34b4bd62ac0941986f33360b98")
"""Source: the example of RTCM 10403, message 1005."""
GNS = "GNGNS,103600.01,5114.51176,N,00012.29380,W,ANNN,07,1.18,111.5,45.6,,"
GLL = "GPGLL,4807.038,N,01131.000,E,123519,A,A"


def fixes(*parts: bytes, size: int = 0) -> tuple[list[GnssFix], ReceiverDecoder]:
    decoder, line = ReceiverDecoder(), b"".join(parts)
    size = size or len(line)
    return [fix for at in range(0, len(line), size) for fix in decoder.feed(line[at : at + size])], decoder


@pytest.mark.parametrize("size", [0, 1, 2, 7])
@pytest.mark.parametrize(
    "noise",
    [
        b"AT+CGNSPWR=1\r\nOK\r\n",
        b"OK",
        b"$GPGGA,0927",
        b"$GPGGA,092725.00,4717.11399,N*",
        b"$GPGGA,092725.00,4717.11399,N*4",
        b"$" * 300,
        b"$GP" + b"x" * 300,
        b"\xb5",
        b"\xb5\x62\x01\x07\x5c\x00",
        b"\xb5\x62\x01\x07\xff\xff",
        PVT[:50],
        RTCM,
        SAT,
        bytes(range(256)),
        b"\x00\xff" * 200,
        b"\\s:r003,n:4085*4F\\",
        b"!AIVDM,1,1,,A,14eG;o@034o8sd<L9i:a;WF>062D,0*7D\r\n",
    ],
)
def test_a_valid_sentence_after_noise_is_taken(noise: bytes, size: int) -> None:
    found, _ = fixes(noise, CLASSIC, noise, UBLOX, size=size)
    assert [fix.satellites for fix in found] == [8, 8]
    assert found[1].lat_deg == pytest.approx(47 + 17.11399 / 60)


@pytest.mark.parametrize("size", [0, 1, 5])
def test_frames_and_sentences_are_read_from_one_line(size: int) -> None:
    found, decoder = fixes(SAT, PVT, CLASSIC, RTCM, SAT, PVT, CLASSIC, size=size)
    assert [fix.satellites for fix in found] == [12, 12], "NAV-PVT is the better message"
    assert decoder.valid == 6


def test_a_sentence_needs_no_line_end() -> None:
    found, decoder = fixes(CLASSIC.strip())
    assert len(found) == 1
    assert not decoder.refused


def test_noise_is_counted_once_per_line() -> None:
    _, decoder = fixes(b"hello\r\nworld\r\n\r\n", CLASSIC, b"half a ", b"line", CLASSIC, size=1)
    assert decoder.refused == {NO_SENTENCE: 3}


@pytest.mark.parametrize("line", [RMC, sentence(GLL)])
def test_receiver_without_gga_gives_fixes_of_two_dimensions(line: bytes) -> None:
    found, decoder = fixes(line * 3)
    assert len(found) == 2, "the first one waits for a better sentence of its epoch"
    assert found[0].lat_deg == pytest.approx(48 + 7.038 / 60)
    assert (found[0].has_height, found[0].h_acc_m, found[0].satellites) == (False, 10.0, 0)
    assert not decoder.refused


def test_receiver_with_gns_only_gives_fixes_with_height() -> None:
    found, decoder = fixes(sentence(GNS))
    assert found == [GnssFix(51 + 14.51176 / 60, -12.29380 / 60, 157.1, 5.9, 7)]
    best, _ = fixes(sentence(GNS.replace("ANNN", "ANRN")))
    assert best[0].h_acc_m == pytest.approx(0.024), "the best of the constellations"
    assert not decoder.refused


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (sentence("GPZDA,201530.00,04,07,2002,00,00"), "none with a position: enable GGA"),
        (sentence("GPRMC,123519,V,,,,,,,230394,,,N"), r"RMC: no fix \(status V, mode N\)"),
        (sentence("GNRMC,123519,A,4807.038,N,01131.000,E,0,0,230394,,,E,V"), "mode E"),
        (sentence("GNRMC,123519,A,4807.038,N,01131.000,E,0,0,230394,,,S"), "mode S"),
        (sentence("GNGNS,,,,,,NNNN,00,99.99,,,,"), r"GNS: no fix \(mode NNNN\)"),
        (sentence("GPGNS,103600.01,,,,,A,04,1.2,,,,"), "GNS: no fix"),
        (sentence("GPGGA,,,,,,0,00,99.9,,,,,,"), r"GGA: no fix \(quality 0\)"),
        (sentence("GPGLL,,,,,,V,N"), "GLL: no fix"),
        (SAT, "none with a position: enable GGA"),
    ],
)
def test_reason_why_there_is_no_position_is_known(line: bytes, reason: str) -> None:
    found, decoder = fixes(line * 3)
    assert found == []
    assert decoder.valid == 3
    assert re.search(reason, decoder.reason)
    assert list(decoder.feed(CLASSIC)), "the first position is taken"


def test_position_before_first_fix_is_refused_with_reason() -> None:
    line = (DATA / "null_island.nmea").read_bytes()
    found, decoder = fixes(line * 3)
    assert found == []
    assert decoder.reason == "GGA: a fix without satellites"
    null = "GPGGA,000000.000,0000.0000,N,00000.0000,E,1,04,2.0,0.0,M,0.0,M,,"
    for sent in (sentence(null), sentence("GPRMC,123519,A,0000.0,S,00000.0,W,0,0,230394,,,A")):
        found, decoder = fixes(sent * 3)
        assert found == []
        assert "a fix at 0° 0°" in decoder.reason
    found, _ = fixes(sentence(null.replace("0000.0000,N", "0000.0001,N")))
    assert len(found) == 1, "the equator is a place"


@pytest.mark.parametrize(
    ("sent", "height_m"),
    [
        (sentence(SOUTH.replace(",354.682,M,-26.574,M,", ",,M,,M,")), math.nan),
        (sentence(SOUTH.replace(",354.682,M,-26.574,M,", ",,,,,")), math.nan),
        (sentence("GNGSA,A,2,04,05,09,,,,,,,,,,3.5,2.1,2.8,1") + sentence(SOUTH), math.nan),
        (sentence("GPGSA,A,3,04,05,09,12,,,,,,,,,2.5,1.3,2.1") + sentence(SOUTH), 328.108),
        (sentence(SOUTH.replace(",-26.574,M,", ",,,")), 354.682),
    ],
)
def test_a_fix_of_two_dimensions_has_no_height(sent: bytes, height_m: float) -> None:
    (fix,), decoder = fixes(sent)
    assert fix.alt_ellipsoid_m == pytest.approx(height_m, nan_ok=True)
    assert fix.has_height == math.isfinite(height_m)
    assert not decoder.refused


@pytest.mark.parametrize(
    ("gst", "dilution", "accuracy_m"),
    [
        ("0.0,0.0", "5.4", 5.4),
        ("0.0,0.0", "0.0", 2.0),
        ("0.0,0.0", "", 2.0),
        (",", "", 2.0),
        ("0.001,0.001", "5.4", 0.01),
        ("0.3,0.4", "0.0", 0.5),
    ],
)
def test_zero_or_missing_accuracy_is_never_perfect(gst: str, dilution: str, accuracy_m: float) -> None:
    stated = sentence(f"GPGST,001037.00,1.2,1.0,0.5,30.0,{gst},0.10")
    (fix,), _ = fixes(stated, sentence(SOUTH.replace(",5.4,", f",{dilution},")))
    assert fix.h_acc_m == accuracy_m


def test_zero_errors_are_named() -> None:
    _, decoder = fixes(sentence("GPGST,001037.00,,,,,0.0,0.0,0.0"))
    assert decoder.refused == {"GST: errors of zero; the dilution is used instead": 1}


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e999", "NaN", "0x10", "1_0"])
def test_numbers_of_python_are_no_numbers_of_receivers(value: str) -> None:
    for field in ("5.4", "354.682", "3334.2313457", "001038.00"):
        assert fixes(sentence(SOUTH.replace(field, value)))[0] == []
    _, decoder = fixes(sentence(f"GPGST,001037.00,,,,,{value},1.0,1.0"))
    assert decoder.refused


def test_errors_hold_over_the_minute_and_over_midnight() -> None:
    for before, after in (("235958.00", "000001.00"), ("001059.00", "001101.00")):
        gst = sentence(f"GPGST,{before},1.2,1.0,0.5,30.0,0.03,0.04,0.10")
        (fix,), _ = fixes(gst, sentence(SOUTH.replace("001038.00", after)))
        assert fix.h_acc_m == 0.05
    (fix,), _ = fixes(gst, sentence(SOUTH.replace("001038.00", "001105.00")))
    assert fix.h_acc_m == 5.4


def test_sentences_with_similar_names_are_ignored() -> None:
    found, decoder = fixes(sentence("PGRMC,A,10.5,100"), sentence("PUBX,00,1,2"), sentence("GPRM,1"))
    assert (found, decoder.valid, dict(decoder.refused)) == ([], 3, {})


ALPHABET = [b"$", b"\xb5", b"\xb5\x62", b"\xb5\x62\x01\x07\x5c\x00", b"*", b"\r\n", CLASSIC, PVT, SAT, RMC]


@given(
    st.lists(st.one_of(st.sampled_from(ALPHABET), st.binary(max_size=80)), max_size=12), st.integers(1, 90)
)
def test_whatever_is_on_line_valid_messages_are_found(parts: list[bytes], size: int) -> None:
    line = b"".join(parts)
    found, decoder = fixes(line, size=size)
    assert all(fix.sigma_m >= 0.01 and fix.has_place for fix in found)
    assert len(decoder._open) <= ubx.HEADER_BYTES + ubx.PAYLOAD_BYTES + ubx.CHECKSUM_BYTES
    taken = decoder.valid
    list(decoder.feed(b"\r\n" + CLASSIC + CLASSIC))
    assert decoder.valid >= taken + 2, "both sentences, behind whatever was open"


def test_a_noisy_line_costs_no_sentence() -> None:
    chance = random.Random(7)
    line, sent = b"", 0
    for _ in range(300):
        line += chance.randbytes(chance.randrange(200)) + b"\r\n"
        line += CLASSIC
        sent += 1
    found, decoder = fixes(line, size=37)
    assert len(found) == sent
    assert sum(decoder.refused.values()) >= 250


def test_reasons_of_receiver_do_not_fill_memory() -> None:
    units = [f"{number:x}" for number in range(2000)]
    found, decoder = fixes(*(sentence(SOUTH.replace(",354.682,M,", f",354.682,{unit},")) for unit in units))
    assert found == []
    assert sum(decoder.refused.values()) == 2000
    assert len(decoder.refused) == 51
    assert decoder.reason == "other reasons"
