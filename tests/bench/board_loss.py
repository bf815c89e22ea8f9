"""A board of 980 bytes at 30 Hz over a link that loses packets: the share that arrives, and its age.

    python tests/bench/board_loss.py [--seconds S] [--json]

Two whole broker cores with beacons at 50 Hz in virtual time, datagrams of 1 to 3 ms; without loss, then with
20 % in both directions. Boards are not sent again. The figures depend on the seed only, not on the machine.
"""

import argparse
import sys
from pathlib import Path
from typing import Final, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[2]))
from rows import Row, print_rows
from tests.simulation.directory.brokers import BrokerNode

from swarmd.broker.config import Config
from swarmd.broker.core.boards.relay_cache import RemoteValue
from swarmware.model.names import data_id
from swarmware.testing.virtual import VirtualClock, VirtualSwarm
from swarmware.types.net import BoardPublication, BoardSubscription, TreePlan

RATE_HZ: Final = 30.0
VALUE_BYTES: Final = 980
"""With type and header the largest value that a beacon takes (1 000 bytes)."""
BEACON_HZ: Final = 50.0
DELAY_S: Final = (0.001, 0.003)
SEED: Final = 1
LOSS: Final = 0.2
ADDED_MS: Final = 1.0
"""A smaller difference of two medians is not a delay of the link."""
BOARD: Final = "sensor/scan"
SCAN: Final = data_id(BOARD, "Blob")


class Passage(NamedTuple):
    """What became of the values of one run."""

    written: int
    received: int
    age_p50_ms: float
    age_p95_ms: float


class BoardLink:
    """A node that writes the board, and a second node that reads it."""

    def __init__(self, loss: float) -> None:
        self.air: VirtualSwarm[str] = VirtualSwarm(SEED, loss=loss, delay_s=DELAY_S)
        self.ages_ms: dict[int, float] = {}
        """By number of the value."""
        self._put = -1
        """Number of the value that the beacons have."""
        config = Config(tick_hz=BEACON_HZ)
        self._writer, self._reader = (
            BrokerNode(
                self.air,
                name,
                VirtualClock(self.air),
                config=config,
                write_boards=self._write,
                on_value=self._take,
            )
            for name in ("uav1", "uav2")
        )
        offers = (BoardPublication(BOARD, SCAN, "Blob"),)
        wants = (BoardSubscription("uav1", BOARD, "Blob", SCAN),)
        for node, plan in (
            (self._writer, TreePlan(1, offers, ())),
            (self._reader, TreePlan(2, (), wants)),
        ):
            node.driver.feed(node.core.on_plan(plan, node.clock.now_ns()))

    def _number(self) -> int:
        """Number of the newest value."""
        return int(self.air.now_ns * RATE_HZ / 1e9)

    def _write(self, node: BrokerNode, now_ns: int) -> None:
        board = node.core.published.boards.get(SCAN)
        number = self._number()
        if board is not None and number != self._put:
            self._put = number
            board.put(number.to_bytes(8, "big") + bytes(VALUE_BYTES - 8), False, now_ns)

    def _take(self, _: BrokerNode, __: BoardSubscription, value: RemoteValue) -> None:
        number = int.from_bytes(value.payload[:8], "big")
        written_ns = number * 1e9 / RATE_HZ
        self.ages_ms.setdefault(number, (self.air.now_ns - written_ns) / 1e6)

    def passage(self, seconds: float) -> Passage:
        """The values of this time, after the first three seconds, in which the nodes meet."""
        self.air.run_for(3.0)
        first = self._number()
        self.air.run_for(seconds)
        last = self._number()
        ages_ms = sorted(age for number, age in self.ages_ms.items() if first < number < last)
        return Passage(
            last - first - 1, len(ages_ms), ages_ms[len(ages_ms) // 2], ages_ms[int(0.95 * len(ages_ms))]
        )


def row(clean: Passage, lossy: Passage) -> Row:
    """The row of the table."""
    share = lossy.received / lossy.written
    added_ms = lossy.age_p50_ms - clean.age_p50_ms
    return Row(
        f"board {RATE_HZ:.0f} Hz, {VALUE_BYTES} B, {LOSS:.0%} loss",
        f"{share:.1%} of {lossy.written} ({clean.received / clean.written:.1%} without loss);"
        f" age p50 {lossy.age_p50_ms:.1f} ms, {added_ms:+.1f} ms against no loss",
        "≥ 79 %, no added delay",
        share >= 0.79 and added_ms <= ADDED_MS,
    )


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    clean, lossy = (BoardLink(loss).passage(given.seconds) for loss in (0.0, LOSS))
    print_rows([row(clean, lossy)], as_json=given.json)


if __name__ == "__main__":
    main()
