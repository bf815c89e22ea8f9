"""Ages of values in 16 bits: 0.1 ms resolution while young, 0.1 s later."""

from typing import Final

AGE_UNIT_US: Final = 100
_OLD: Final = 0x8000
_OLD_UNIT_US: Final = 100_000


def encode_age(age_us: int) -> int:
    """Encodes an age: 0.1 ms up to 3.2 s, 0.1 s up to 54 min, which is the maximum."""
    fine = max(age_us, 0) // AGE_UNIT_US
    return fine if fine < _OLD else _OLD | min(age_us // _OLD_UNIT_US, _OLD - 1)


def decode_age(age: int) -> int:
    """Decodes an age, in µs."""
    return age * AGE_UNIT_US if age < _OLD else (age & ~_OLD) * _OLD_UNIT_US
