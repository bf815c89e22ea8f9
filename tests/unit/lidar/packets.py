"""Packets of a VLP-16 in surroundings that a function describes."""

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Final

from swarmd.lidar.core.turn_decoder import ELEVATIONS_DEG

BLOCK_DEG: Final = 0.4
"""Azimuth between two blocks, which have two firings each, at 10 turns a second."""
Surroundings = Callable[[float, float], float]
"""Distance in m, by azimuth (clockwise from the lidar's zero) and elevation in rad, or 0 without an echo."""


def turn(surroundings: Surroundings, blocks: int = 900) -> list[bytes]:
    """Packets of one turn, of which there are 75."""
    made = []
    for number in range(blocks):
        azimuth = number * BLOCK_DEG
        block = struct.pack("<HH", 0xEEFF, round(azimuth * 100))
        for firing in (0.0, BLOCK_DEG / 2):
            for elevation in ELEVATIONS_DEG:
                distance = surroundings(math.radians(azimuth + firing), math.radians(elevation))
                block += struct.pack("<HB", round(distance / 0.002), 100)
        made.append(block)
    return [b"".join(part) + bytes(6) for part in _twelve(made)]


def _twelve(blocks: list[bytes]) -> list[list[bytes]]:
    return [blocks[at : at + 12] for at in range(0, len(blocks), 12)]


def wall(ahead_m: float) -> Surroundings:
    """Surroundings with a single wall ahead."""

    def distance(azimuth: float, elevation: float) -> float:
        towards = math.cos(azimuth) * math.cos(elevation)
        return ahead_m / towards if towards > 0.1 and ahead_m / towards < 100.0 else 0.0

    return distance


def ground(height_m: float) -> Surroundings:
    """Level ground below a lidar at this height."""
    return lambda _, elevation: height_m / -math.sin(elevation) if elevation < 0 else 0.0


RECORDING = Path(__file__).parents[3] / "share/swarm/data/vlp16/recording.bin"


PACKET = 1206


def recording() -> list[bytes]:
    data = RECORDING.read_bytes()
    return [data[at : at + PACKET] for at in range(0, len(data), PACKET)]
