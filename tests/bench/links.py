"""The table of links: runs the benchmarks that measure its rows, and writes share/doc/links.md.

    python tests/bench/links.py [--only NAME]... [--write]

Each benchmark is a command of its own, which the table names. `--only`: one of them; the other rows stay as
they were measured last. `--write`: keeps the figures in share/doc/links.json and writes the page from them.
A benchmark with a ratio that was taken under load is not written: its former rows stay.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, NamedTuple

from rows import REFUSED, Row

ROOT: Final = Path(__file__).parents[2]
KEPT: Final = ROOT / "share/doc/links.json"
PAGE: Final = ROOT / "share/doc/links.md"
BEGIN: Final = "<!-- rows: written by tests/bench/links.py -->\n"
END: Final = "<!-- end of rows -->\n"


def own_rows(lines: list[str]) -> Iterator[Row]:
    """Rows that a benchmark prints itself."""
    for line in lines:
        yield Row(**json.loads(line))


def message_rows(lines: list[str]) -> Iterator[Row]:
    """Of tests/bench/message.py."""
    figures = json.loads(lines[-1])
    for size, way in ((200, "in a sealed datagram"), (2000, "over the connection with CURVE")):
        found = figures[str(size)]
        ours, bare = found["app_broker_broker_app_us"]["p50"], found["zeromq_curve_tcp_us"]["p50"]
        yield Row(
            f"message of {size} B app → broker → broker → app, {way}",
            f"p50 {ours:.0f} µs, bare ZeroMQ with CURVE {bare:.0f} µs: {ours / bare:.2f} times",
            "≤ 2.5 times",
            ours <= 2.5 * bare,
            found["refusal"],
        )


def pose_rows(lines: list[str]) -> Iterator[Row]:
    """Of tests/bench/pose_ages.py."""
    found: dict[str, dict[str, float]] = json.loads(lines[-1])
    for swarm, limit_bytes_s, limit_s in (("16 nodes", 4700, 0.3), ("100 nodes", 7200, 0.32)):
        figures = found[swarm]
        bytes_s, age_s = figures["bytes_s_of_a_node"], figures["2_hops_p95_s"]
        yield Row(
            f"{swarm} (virtual time), poses at 10 Hz",
            f"{bytes_s / 1000:.2f} kB/s a node; age p95 at two hops {age_s:.2f} s",
            f"≤ {limit_bytes_s / 1000:g} kB/s; ≤ {limit_s:g} s",
            bytes_s <= limit_bytes_s and age_s <= limit_s,
        )
    cell_bytes_s = found["16 nodes in one cell"]["bytes_s_of_all"]
    yield Row(
        "one cell of 16 (virtual time), poses at 10 Hz",
        f"{cell_bytes_s / 1000:.2f} kB/s in all",
        "≤ 27 kB/s",
        cell_bytes_s <= 27_000,
    )


class LinkBench(NamedTuple):
    """A benchmark, its command, and how its output becomes rows."""

    name: str
    script: str
    rows: Callable[[list[str]], Iterator[Row]]
    cases: str
    """What it measures, for the page where it was not run."""


BENCHES: Final = (
    LinkBench("boards", "board_loss.py", own_rows, "board 30 Hz, 1 kB, 20 % loss"),
    LinkBench("radio", "radio_links.py", own_rows, "messages over 1 and 3 bad hops; cuts and returns"),
    LinkBench("busy", "busy_links.py", own_rows, "stream and messages at 40 % loss beside busy loops"),
    LinkBench("notice", "link_notice.py", own_rows, "cuts at 10 and 2 Hz (virtual time)"),
    LinkBench("reliable", "reliable_links.py", own_rows, "streams, bytes sent again, overload, files"),
    LinkBench(
        "channels", "channel_links.py", own_rows, "VLP-16 stream; rate, buffer and outage of its channel"
    ),
    LinkBench(
        "formation",
        "formations.py",
        own_rows,
        "`lab run formation` over the radio `s3`, and with 32 nodes in one cell",
    ),
    LinkBench("message", "message.py", message_rows, "message with CURVE against bare ZeroMQ"),
    LinkBench("poses", "pose_ages.py", pose_rows, "bytes and ages of poses, 16 and 100 nodes"),
)


def measured(bench: LinkBench) -> tuple[dict[str, Any], list[Row]]:
    """Runs a benchmark; the entry of the file of figures, and its rows. Raises: CalledProcessError."""
    before = os.getloadavg()[0]
    command = [sys.executable, f"tests/bench/{bench.script}", "--json"]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode not in (0, REFUSED):
        done.check_returncode()
    rows = list(bench.rows([line for line in done.stdout.splitlines() if line.startswith("{")]))
    entry = {
        "measured": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "machine": machine(),
        "load": f"{before:.1f}",
        "rows": [row._asdict() for row in rows],
    }
    return entry, rows


def machine() -> str:
    """Processor and number of cores."""
    lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{os.cpu_count()} cores {models[0] if models else os.uname().machine}"


def table(kept: dict[str, Any]) -> str:
    """The generated part of the page."""
    lines = ["| case | measured | goal | met | command |", "|---|---|---|---|---|"]
    for bench in BENCHES:
        command = f"`python tests/bench/{bench.script}`"
        found = kept.get(bench.name)
        if found is None:
            lines.append(f"| {bench.cases} | not measured | | | {command} |")
            continue
        for row in found["rows"]:
            met = "yes" if row["is_met"] else "**no**"
            lines.append(f"| {row['name']} | {row['figure']} | {row['goal']} | {met} | {command} |")
    lines += ["", "| benchmark | measured | machine | load before it |", "|---|---|---|---|"]
    for bench in BENCHES:
        if (found := kept.get(bench.name)) is not None:
            lines.append(f"| `{bench.script}` | {found['measured']} | {found['machine']} | {found['load']} |")
    return "\n".join(lines) + "\n"


def written(page: str, kept: dict[str, Any]) -> str:
    """The page with the rows that are kept."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{table(kept)}\n{END}{after}"


def main() -> int:
    """Measures, prints and writes; rows that are refused are not written."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    names = [bench.name for bench in BENCHES]
    parser.add_argument("--only", action="append", choices=names, help="one of the benchmarks")
    parser.add_argument("--write", action="store_true", help="keep the figures and write the page")
    given = parser.parse_args()
    kept: dict[str, Any] = json.loads(KEPT.read_text("utf-8")) if KEPT.exists() else {}
    failed = missed = refused = 0
    for bench in BENCHES:
        if given.only and bench.name not in given.only:
            continue
        try:
            entry, rows = measured(bench)
        except subprocess.CalledProcessError as error:
            failed += 1
            print(f"{bench.script}: not measured, it ended with {error.returncode}", file=sys.stderr)
            continue
        for row in rows:
            missed += not row.is_met
            print(f"{row.name}: {row.figure} (goal {row.goal})   {row.verdict}".rstrip(), flush=True)
        if any(row.refusal for row in rows):
            refused += 1
            continue
        kept[bench.name] = entry
        if given.write:
            KEPT.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", "utf-8")
            PAGE.write_text(written(PAGE.read_text("utf-8"), kept), "utf-8")
    return 1 if failed else 3 if refused or missed else 0


if __name__ == "__main__":
    sys.exit(main())
