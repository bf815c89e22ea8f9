"""Registers and formulas of the barometers BMP280 and BME280, without the humidity of the BME280."""

import struct
from typing import Final

import msgspec

from swarmware.errors import WireError
from swarmware.types.vehicle import Barometer

ID: Final = 0xD0
CHIPS: Final = {0x56: "BMP280", 0x57: "BMP280", 0x58: "BMP280", 0x60: "BME280"}
"""Chips by the content of the register `ID`; the first two are engineering samples."""
CALIBRATION: Final = 0x88
CALIBRATION_BYTES: Final = 24
CONTROL: Final = 0xF4
NORMAL: Final = 0x57
"""Control value: oversampling of 2 for temperature and 16 for pressure, in continuous mode."""
CONFIG: Final = 0xF5
FILTERED: Final = 0x10
"""Configuration value: the shortest pause, 0.5 ms, and a filter over 16 values."""
DATA: Final = 0xF7
DATA_BYTES: Final = 6
RATE_HZ: Final = 23.0
"""Measurements per second with these settings, 43.2 ms each."""
_FORM: Final = struct.Struct("<HhhHhhhhhhhh")
_SKIPPED: Final = 0x80000
"""Raw value before the first measurement."""


class Calibration(msgspec.Struct, frozen=True):
    """Calibration coefficients of one chip, T1 to T3 and P1 to P9."""

    t: tuple[int, ...]
    p: tuple[int, ...]


def calibration(data: bytes) -> Calibration:
    """Decodes the coefficients in the registers of a chip. Raises: WireError when they are invalid."""
    # equal bytes, all 0 or all 255, come from a bus without a device
    if len(data) != CALIBRATION_BYTES or len(set(data)) == 1:
        raise WireError("no calibration: expected 24 bytes that differ")
    values = _FORM.unpack(data)
    return Calibration(values[:3], values[3:])


def measurement(data: bytes, chip: Calibration) -> Barometer:
    """Computes pressure and temperature from the contents of the data registers.

    Raises: WireError before the first measurement, or when the result is outside of the chip's range.
    Source: BMP280 data sheet 1.14, sections 3.11.3, 3.12 and 8.1.
    """
    if len(data) != DATA_BYTES:
        raise WireError(f"{len(data)} bytes, expected {DATA_BYTES}")
    raw_pressure = data[0] << 12 | data[1] << 4 | data[2] >> 4
    raw_temperature = data[3] << 12 | data[4] << 4 | data[5] >> 4
    if _SKIPPED in (raw_pressure, raw_temperature):
        raise WireError("no measurement yet")
    # floating-point variant of the data sheet's formulas
    t1, t2, t3 = chip.t
    fine = (raw_temperature / 16384 - t1 / 1024) * t2 + (raw_temperature / 131072 - t1 / 8192) ** 2 * t3
    temperature_degc = fine / 5120
    pressure_pa = _pressure_pa(raw_pressure, fine, chip.p)
    if not (-40 <= temperature_degc <= 85 and 30_000 <= pressure_pa <= 110_000):
        raise WireError(f"{pressure_pa:.0f} Pa at {temperature_degc:.1f} °C, outside of the chip's range")
    return Barometer(round(pressure_pa, 2), round(temperature_degc, 2))


def _pressure_pa(raw: int, fine: float, p: tuple[int, ...]) -> float:
    """Pressure by the formula of the data sheet, or 0 if the coefficients are invalid."""
    a = fine / 2 - 64000
    b = (a * a * p[5] / 32768 + a * p[4] * 2) / 4 + p[3] * 65536
    a = (1 + (p[2] * a * a / 524288 + p[1] * a) / 524288 / 32768) * p[0]
    if a == 0:
        return 0.0
    found = (1048576 - raw - b / 4096) * 6250 / a
    return found + (p[8] * found * found / 2147483648 + found * p[7] / 32768 + p[6]) / 16
