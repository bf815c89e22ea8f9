"""Sentences and messages of GNSS receivers."""

import struct
from functools import reduce
from operator import xor

UBLOX = b"$GNGGA,092725.00,4717.11399,N,00833.91590,E,1,08,1.01,499.6,M,48.0,M,,*45\r\n"
"""Source: u-blox M8 receiver description, GGA (with talker GN)."""


CLASSIC = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n"
"""Source: the example of NMEA 0183 descriptions."""


SOUTH = "GPGGA,001038.00,3334.2313457,S,11211.0576940,W,2,04,5.4,354.682,M,-26.574,M,7.0,0138"


RMC = b"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A\r\n"


def sentence(text: str) -> bytes:
    return b"$%s*%02X\r\n" % (text.encode(), reduce(xor, text.encode(), 0))


def pvt(
    fix_type: int = 3, flags: int = 1, satellites: int = 12, accuracy_mm: int = 812, **more: int
) -> bytes:
    """The payload of NAV-PVT, field by field as in the receiver description."""
    place = {"lat_e7": 472852330, "lon_e7": 85652650, "height_mm": 547600, "flags3": 0} | more
    time = struct.pack("<IHBBBBBBIi", 1000, 2026, 11, 27, 23, 59, 58, 0x37, 20, -500_000_000)
    fix = struct.pack("<BBBB", fix_type, flags, 0, satellites)
    where = struct.pack(
        "<iiiiII", place["lon_e7"], place["lat_e7"], place["height_mm"], 499600, accuracy_mm, 1300
    )
    motion = struct.pack("<iiiiiIIH", 10, -20, 0, 22, 0, 50, 100, 123)
    return time + fix + where + motion + struct.pack("<H", place["flags3"]) + bytes(12)
