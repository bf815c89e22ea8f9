"""Reduction and processor time of the compressions of channels, on a real lidar and on images.

    python tests/bench/compression.py [--json]

`reduction`: of the bytes of the payload. `core %`: of one core at the rate of the device, coding and decoding
apart; the least of several rounds. The lidar is the recording of a VLP-16 in `share/swarm/data`: raw packets,
a whole turn in a value and 26 in a notification, and the same turns as points of 32 bytes with padding. The
image is drawn: a gradient with noise and edges.
"""

import argparse
import json
import math
import random
import struct
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import msgspec

from swarmctl.terminal.table import Column, fitted_table
from swarmware.model.compression import Compression, pack, unpack
from swarmware.model.record_filter import NO_RECORDS, VLP16_PACKET, Layout, Records, vlp16_records
from swarmware.module.jpeg import to_jpeg, to_pixels
from swarmware.types.perception import Image, ImageEncoding

RECORDING: Final = Path(__file__).parents[2] / "share/swarm/data/vlp16/recording.bin"
PACKETS_HZ: Final = 753.0
TURN: Final = 76
"""Packets of a turn at 10 Hz."""
NOTIFICATION: Final = 26
"""Packets that fit into one notification."""
ELEVATION_DEG: Final = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)
RANGE_M: Final = 0.002
POINT: Final = struct.Struct("<fff4xfH10x")
"""PointXYZIR of the ROS driver: 32 bytes, 14 of them padding."""
ROUNDS: Final = 3
IMAGE_HZ: Final = 10.0
WIDTH, HEIGHT = 640, 480


class Row(msgspec.Struct, frozen=True):
    """One measured combination."""

    what: str
    method: str
    reduction: float
    coding_core_ratio: float
    decoding_core_ratio: float


def points(packets: bytes) -> bytes:
    """The valid points of packets."""
    out = bytearray()
    for block in range(len(packets) // VLP16_PACKET * 12):
        at = block // 12 * VLP16_PACKET + block % 12 * 100
        angle = math.radians(struct.unpack_from("<H", packets, at + 2)[0] / 100)
        for channel in range(32):
            distance, intensity = struct.unpack_from("<HB", packets, at + 4 + 3 * channel)
            if distance:
                elevation = math.radians(ELEVATION_DEG[channel % 16])
                level_m = distance * RANGE_M * math.cos(elevation)
                out += POINT.pack(
                    level_m * math.cos(angle),
                    -level_m * math.sin(angle),
                    distance * RANGE_M * math.sin(elevation),
                    float(intensity),
                    channel % 16,
                )
    return bytes(out)


def picture() -> Image:
    """A drawn image: sky, ground with texture, and noise of the sensor."""
    noise = random.Random(1)
    data = bytearray()
    for y in range(HEIGHT):
        for x in range(WIDTH):
            ground = y > HEIGHT // 2 + 20 * math.sin(x / 40)
            base = 90 + 30 * ((x // 32 + y // 24) % 2) if ground else 220 - y // 4
            data += bytes(min(255, max(0, base + shift + round(noise.gauss(0, 2)))) for shift in (0, 8, 20))
    return Image(WIDTH, HEIGHT, ImageEncoding.RGB8, bytes(data))


def least_s(step: Callable[[], object]) -> float:
    """Processor time of one step."""
    times = []
    for _ in range(ROUNDS):
        began = time.process_time_ns()
        step()
        times.append(time.process_time_ns() - began)
    return min(times) / 1e9


def lossless(what: str, values: Sequence[bytes], records: Sequence[Records], method: str, hz: float) -> Row:
    """Measures a lossless method and verifies its inverse."""
    compression = Compression.parse(method)
    coded = [pack(value, compression, one) for value, one in zip(values, records, strict=True)]
    if [unpack(one) for one in coded] != list(values):
        raise SystemExit(f"{what}, {method}: decoded values differ")
    coding_s = least_s(lambda: [pack(v, compression, one) for v, one in zip(values, records, strict=True)])
    decoding_s = least_s(lambda: [unpack(one) for one in coded])
    filtered = records[0].layout is not Layout.BYTES
    return Row(
        what,
        f"columns, {compression}" if filtered else str(compression),
        1 - sum(map(len, coded)) / sum(map(len, values)),
        coding_s * hz / len(values),
        decoding_s * hz / len(values),
    )


def measure() -> list[Row]:
    """All rows."""
    recording = RECORDING.read_bytes()
    rows = []
    for what, count in (("VLP-16 turns", TURN), (f"VLP-16, {NOTIFICATION} packets", NOTIFICATION)):
        size = count * VLP16_PACKET
        values = [recording[at : at + size] for at in range(0, len(recording) - size + 1, size)]
        hz = PACKETS_HZ / count
        rows.append(lossless(what, values, [NO_RECORDS] * len(values), "zlib:6", hz))
        rows += [
            lossless(what, values, list(map(vlp16_records, values)), method, hz)
            for method in ("zlib:1", "zlib:6", "zstd:1", "zstd:3")
        ]
    size = TURN * VLP16_PACKET
    clouds = [points(recording[at : at + size]) for at in range(0, len(recording) - size + 1, size)]
    records = [Records(Layout.RECORDS, POINT.size, len(cloud)) for cloud in clouds]
    hz = PACKETS_HZ / TURN
    for method in ("zlib:1", "zlib:6", "zstd:1"):
        rows.append(lossless("points of 32 bytes", clouds, [NO_RECORDS] * len(clouds), method, hz))
        rows.append(lossless("points of 32 bytes", clouds, records, method, hz))
    image = picture()
    for quality in (50, 80, 95):
        coded = to_jpeg(image, quality)
        rows.append(
            Row(
                f"image {WIDTH}x{HEIGHT}",
                f"jpeg:{quality}",
                1 - len(coded.data) / len(image.data),
                least_s(lambda quality=quality: to_jpeg(image, quality)) * IMAGE_HZ,  # type: ignore[misc]
                least_s(lambda coded=coded: to_pixels(coded)) * IMAGE_HZ,  # type: ignore[misc]
            )
        )
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    rows = measure()
    if args.json:
        print(json.dumps(msgspec.to_builtins(rows), indent=2))
        return 0
    columns = (
        Column("value"),
        Column("compression"),
        Column("reduction %", right=True),
        Column("coding, core %", right=True),
        Column("decoding, core %", right=True),
    )
    table = [
        (
            row.what,
            row.method,
            f"{100 * row.reduction:.1f}",
            f"{100 * row.coding_core_ratio:.1f}",
            f"{100 * row.decoding_core_ratio:.1f}",
        )
        for row in rows
    ]
    print(fitted_table(columns, table).text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
