"""Frames of 140 bytes into the local ring, beside the bare MCAP writer and SQLite in one run."""

import sqlite3
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mcap.writer import Writer

from swarmware.recorder.ring import LogRing, segments
from swarmware.recorder.segment import LogChannel, SegmentReader

COUNT = 100_000
PAYLOAD = bytes(140)
BATCH = 500


def ours(directory: Path) -> None:
    """The logger's own ring, a batch every 500 entries."""
    ring = LogRing(directory / "ring", segment_bytes=1 << 30, ring_bytes=1 << 31)
    channel = LogChannel("uav1", "nav/pose", "board", "Pose", "uav1:navigator:out")
    for number in range(COUNT):
        ring.append(channel, number, number, PAYLOAD)
        if number % BATCH == 0:
            ring.flush()
    ring.close()


def bare_mcap(directory: Path) -> None:
    """The MCAP library with its defaults: chunks of 1 MiB, zstd."""
    with (directory / "bare.mcap").open("wb") as file:
        writer: Any = Writer(file)
        writer.start()
        channel = writer.register_channel("/uav1/nav/pose", "msgpack", 0)
        for number in range(COUNT):
            writer.add_message(channel, number, PAYLOAD, number, number)
        writer.finish()


def sqlite(directory: Path) -> None:
    """SQLite with a write-ahead log, a transaction every 500 rows."""
    base = sqlite3.connect(directory / "bare.sqlite")
    base.execute("pragma journal_mode=wal")
    base.execute("pragma synchronous=normal")
    base.execute(
        "create table frames (sequence integer primary key, topic text, stamp integer, payload blob)"
    )
    for start in range(0, COUNT, BATCH):
        rows = ((number, "/uav1/nav/pose", number, PAYLOAD) for number in range(start, start + BATCH))
        base.executemany("insert into frames values (?, ?, ?, ?)", rows)
        base.commit()
    base.close()


def seconds(run: Callable[[Path], None], directory: Path) -> float:
    """Best of three."""
    best = float("inf")
    for turn in range(3):
        place = directory / f"{run.__name__}{turn}"
        place.mkdir()
        start = time.perf_counter()
        run(place)
        best = min(best, time.perf_counter() - start)
    return best


def main() -> None:
    """Prints the table."""
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        reference = seconds(ours, directory)
        print(f"{'writer':<28}{'frames/s':>12}{'ours is':>10}")
        for label, taken in [
            ("local ring", reference),
            ("mcap library, zstd chunks", seconds(bare_mcap, directory)),
            ("sqlite, write-ahead log", seconds(sqlite, directory)),
        ]:
            print(f"{label:<28}{COUNT / taken:>12,.0f}{taken / reference:>9.2f}x")
        start = time.perf_counter()
        path = segments(directory / "ours0" / "ring")[0]
        found = sum(1 for _ in SegmentReader(path).entries())
        rate = found / (time.perf_counter() - start)
        print(f"read back: {rate:,.0f} frames/s from {path.stat().st_size >> 20} MiB")


if __name__ == "__main__":
    main()
