"""Frames of 140 bytes into the local ring, beside the bare MCAP writer and SQLite in one run.

And what it costs that a segment is complete after each batch: beside a file that one write extends. A ratio
is refused if its bare figure is more than 20 % above the best of three that are taken at the start.
"""

import os
import shutil
import sqlite3
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

from mcap.writer import Writer
from rows import REFUSED, Bare

from swarmware.recorder import segment
from swarmware.recorder.growing_file import GrowingFile
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


def once_s(run: Callable[[Path], None], directory: Path) -> float:
    """Time of one run in a folder of its own."""
    place = Path(tempfile.mkdtemp(prefix=run.__name__, dir=directory))
    start = time.perf_counter()
    run(place)
    taken = time.perf_counter() - start
    if run is not ours:
        shutil.rmtree(place)
    return taken


def seconds(run: Callable[[Path], None], directory: Path) -> float:
    """Best of three."""
    return min(once_s(run, directory) for _ in range(3))


class OneWrite(GrowingFile):
    """The file without its end: each batch is one write behind the last one."""

    def flush(self) -> None:
        """Writes the buffer."""
        os.pwrite(self._fd, bytes(self._waiting), self._on_disk)
        if self._new is not None:
            self._new.rename(self._path)
            self._new = None
        self._on_disk += len(self._waiting)
        self._waiting.clear()


def entry_us(directory: Path, file: type[GrowingFile], batch: int) -> float:
    """Processor time of one entry."""
    with patch.object(segment, "GrowingFile", file):
        ring = LogRing(directory, segment_bytes=1 << 30, ring_bytes=1 << 31)
    channel = LogChannel("uav1", "nav/pose", "board", "Pose", "uav1:navigator:out")
    count = min(COUNT, 2000 * batch)
    start = time.process_time()
    for number in range(count):
        ring.append(channel, number, number, PAYLOAD)
        if number % batch == 0:
            ring.flush()
    taken = time.process_time() - start
    ring.close()
    shutil.rmtree(directory)
    return taken / count * 1e6


def completeness(directory: Path) -> None:
    """Prints the cost of an end after each batch, by the size of the batches; best of seven, in turns."""
    print(f"\n{'entries in a batch':<20}{'µs/entry':>10}{'one write':>11}{'more':>8}{'µs/batch':>10}")
    for batch in (1, 10, 50, 500):
        best: dict[type[GrowingFile], float] = {}
        for turn in range(7):
            for file in (GrowingFile, OneWrite):
                taken = entry_us(directory / f"{file.__name__}{batch}.{turn}", file, batch)
                best[file] = min(best.get(file, taken), taken)
        ours, reference = best[GrowingFile], best[OneWrite]
        more = f"{ours / reference - 1:.0%}"
        print(f"{batch:<20}{ours:>10.2f}{reference:>11.2f}{more:>8}{(ours - reference) * batch:>10.1f}")


def main() -> int:
    """Prints the table; not 0 when a ratio is refused."""
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        peers = {"mcap library, zstd chunks": bare_mcap, "sqlite, write-ahead log": sqlite}
        bare = {
            label: Bare.measured(lambda run=run: once_s(run, directory))  # type: ignore[misc]  # of this one
            for label, run in peers.items()
        }
        reference = seconds(ours, directory)
        print(f"{'writer':<28}{'frames/s':>12}{'ours is':>10}")
        print(f"{'local ring':<28}{COUNT / reference:>12,.0f}{1:>9.2f}x")
        for label, run in peers.items():
            taken = seconds(run, directory)
            refusal = bare[label].refusal(taken)
            refused = f"   REFUSED: {refusal}" if refusal else ""
            print(f"{label:<28}{COUNT / taken:>12,.0f}{taken / reference:>9.2f}x{refused}")
        start = time.perf_counter()
        path = segments(next(directory.glob("ours*")) / "ring")[0]
        found = sum(1 for _ in SegmentReader(path).entries())
        rate = found / (time.perf_counter() - start)
        print(f"read back: {rate:,.0f} frames/s from {path.stat().st_size >> 20} MiB")
        completeness(directory)
    return REFUSED if any(one.refused for one in bare.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
