"""What a link that loses packets or is slow delivers: figures beside their goals.

    python tests/bench/reliable_links.py [--json] [--recording FILE]

The cores of both ends in virtual time, 20 ms round trip, random loss in both directions, five seeds each; and
two brokers over a loopback of 1 Mbit/s in a network namespace, which needs root.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[2]))
from rows import Row, print_rows
from tests.integration.broker.namespace import figures_of
from tests.simulation.reliable.radio_link import Medium, Pair, S, latencies_ms

from swarmware.model.frame import FrameKind

SEEDS: Final = range(1, 6)
LASTS_S: Final = 20
ITEM_BYTES: Final = 1000
LOSSES: Final = (0.0, 0.1, 0.2, 0.3, 0.4)
OVERLOAD_S: Final = 20


def in_order_s(received: list[int], end_ns: int) -> float:
    """Items that a reader who takes them in order has at the end, per second."""
    return received_in_order(received) / (end_ns / S)


def received_in_order(numbers: list[int]) -> int:
    """Items up to the first that is missing."""
    seen = set(numbers)
    count = 0
    while count + 1 in seen:
        count += 1
    return count


def stream_rows(rate_hz: int = 30) -> Iterator[Row]:
    """A stream at each loss: whole, in order, in time, and what is sent again for it."""
    for loss in LOSSES:
        if rate_hz != 30 and loss not in (0.0, 0.3):
            continue
        sent = arrived = useful = repeated = 0
        rates: list[float] = []
        late: list[float] = []
        for seed in SEEDS:
            pair = Pair(Medium(seed, loss=loss), Medium(1000 + seed, loss=loss), loss=loss)
            start_ns = pair.now_ns
            end_ns = start_ns + LASTS_S * S - 1
            pair.every(S // rate_hz, end_ns, lambda pair=pair: pair.send(ITEM_BYTES))  # type: ignore[misc]  # of this iteration
            pair.run(end_ns)
            rates.append(in_order_s([frame.sequence for _, frame in pair.received[2]], end_ns - start_ns))
            pair.run(end_ns + 6 * S)
            sent += pair.sent
            arrived += received_in_order([frame.sequence for _, frame in pair.received[2]])
            useful += sum(len(frame.payload) for _, frame in pair.received[2])
            repeated += pair.end(1).repeated_bytes
            late += latencies_ms(pair.received[2])
        least = rate_hz - (0.5 if loss < 0.4 else 1.0) if rate_hz == 30 else 0.0
        p99_ms = sorted(late)[int(0.99 * len(late))]
        yield Row(
            f"stream {rate_hz} x 1 kB/s, {loss:.0%} loss",
            f"{arrived / sent:.1%} in order, {min(rates):.1f} /s, p99 {p99_ms:.0f} ms",
            f"100 % in order, ≥ {least} /s" if least else "100 % in order",
            arrived == sent and min(rates) >= least,
        )
        most = 1.5 * loss / (1 - loss)
        yield Row(
            f"sent again, {rate_hz} x 1 kB/s, {loss:.0%} loss",
            f"{repeated / useful:.2f} of the useful bytes",
            f"≤ {most:.2f}",
            repeated / useful <= most,
        )


def message_rows() -> Iterator[Row]:
    """Commands beside a stream at 30 % loss."""
    sent = arrived = 0
    late: list[float] = []
    for seed in SEEDS:
        pair = Pair(Medium(seed, loss=0.3), Medium(1000 + seed, loss=0.3), loss=0.3)
        end_ns = pair.now_ns + LASTS_S * S
        pair.every(S // 5, end_ns, lambda pair=pair: pair.send(200, FrameKind.MESSAGE))  # type: ignore[misc]  # of this iteration
        pair.run(end_ns + 6 * S)
        sent += pair.sent
        arrived += len(pair.received[2])
        late += latencies_ms(pair.received[2])
    p99_ms = sorted(late)[int(0.99 * len(late))]
    yield Row(
        "message, 30 % loss, 1 hop",
        f"{arrived / sent:.1%}, p99 {p99_ms:.0f} ms",
        "100 % delivered or reported, p99 < 1000 ms",
        arrived == sent and p99_ms < 1000,
    )


def overload_rows() -> Iterator[Row]:
    """Two brokers on a loopback of 1 Mbit/s that is offered ten times as much."""
    seen = figures_of("overload.py", str(OVERLOAD_S), tools=("ip", "tc"))
    for what in ("command", "beacon"):
        yield Row(
            f"{what}s, ten times overload of 1 Mbit/s",
            f"p99 {seen[f'{what}_p99_ms']:.0f} ms of {seen[f'{what}s']:.0f}",
            "p99 < 300 ms",
            seen[f"{what}_p99_ms"] < 300,
        )


def file_rows() -> Iterator[Row]:
    """`swarmctl file send` and `get` of 1 MB over a loopback that drops packets, without and with a cut."""
    for cut_s in (0, 10):
        seen = figures_of("../files/lossyfile.py", "20", str(cut_s), tools=("ip", "nft"))
        whole = bool(seen["sent"] and seen["fetched"] and seen["digests"] == 1)
        state = "whole" if whole else "damaged"
        yield Row(
            "file of 1 MB, 20 % loss" + (f", cut for {cut_s} s" if cut_s else ""),
            f"{state}, sent in {seen['sent_s']:.1f} s, fetched in {seen['got_s']:.1f} s",
            "complete, right hash, resumed",
            whole,
        )


def scanner_rows(recording: str) -> Iterator[Row]:
    """Streams between two nodes with trees, over a loopback: lossy, or slower than the stream."""
    packets = ("--recording", recording) if recording else ()
    for what, options, tools in (
        ("30 % loss", ("--loss", "30"), ("ip", "nft")),
        ("a link of 1 Mbit/s", ("--link", "1mbit"), ("ip", "tc")),
    ):
        seen = figures_of("../tree/lossystream.py", "753", "8", *options, *packets, tools=tools)
        missing = seen["written"] - seen["received"]
        reported = missing == seen["reader_lost"] == seen["writer_lost"]
        gaps = f"reported to the reader {seen['reader_lost']:.0f}, to the owner {seen['writer_lost']:.0f}"
        yield Row(
            f"scanner, 753 packets/s, {what}",
            f"{missing:.0f} of {seen['written']:.0f} missing, {gaps}",
            "none missing, or reported at both ends",
            bool(seen["in_order"] and reported),
        )
    for loss, least in (("0", 29.5), ("30", 29.5), ("40", 29.0)):
        seen = figures_of("../tree/lossystream.py", "30", "20", "--loss", loss, tools=("ip", "nft"))
        share = seen["received"] / seen["written"]
        yield Row(
            f"stream 30 x 1 kB/s, {loss} % loss, two nodes",
            f"{share:.1%}, {seen['received_s']:.1f} /s, p99 {seen['p99_ms']:.0f} ms",
            f"100 % in order, ≥ {least} /s",
            bool(seen["in_order"] and seen["received"] == seen["written"] and seen["received_s"] >= least),
        )


def rows(recording: str = "") -> Iterator[Row]:
    """All rows; `recording`: file with packets of a scanner, 1 206 bytes each."""
    yield from stream_rows()
    yield from stream_rows(100)
    yield from message_rows()
    yield from overload_rows()
    yield from file_rows()
    yield from scanner_rows(recording)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--recording", default="")
    args = parser.parse_args()
    print_rows(rows(args.recording), as_json=args.json)


if __name__ == "__main__":
    main()
