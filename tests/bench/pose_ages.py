"""Ages of poses by distance, and bytes of beacons, in swarms of whole broker cores in virtual time.

    python tests/bench/pose_ages.py [--relay-bytes N] [--json] [--seed N]

Every node subscribes to the poses of all others at 10 Hz; nodes move at 5 m/s, and radios lose datagrams by
distance. The figures depend on the seeds only, not on the machine. Hops are those over links that deliver at
least 85 %.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Final

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
from tests.simulation.directory.air import Air

from swarmd.broker.config import Config

HOPS_SHOWN: Final = 5


def measure(first_seed: int) -> dict[str, dict[str, float]]:
    """The figures of five swarms of 16 nodes, one of 100, and one cell of 16."""
    found: dict[str, dict[str, float]] = {}
    for name, seeds, count, degree, warm_s, seconds in (
        ("16 nodes", range(first_seed, first_seed + 5), 16, 6.0, 4.0, 8.0),
        ("100 nodes", range(first_seed, first_seed + 1), 100, 9.0, 7.0, 2.0),
    ):
        ages_s: dict[int, list[float]] = {}
        sent = 0.0
        for seed in seeds:
            air = Air(seed, count, degree, 5.0)
            air.fly(warm_s, look=False)
            before = air.sent_bytes_all()
            air.fly(seconds, look=True)
            sent += (air.sent_bytes_all() - before) / count / seconds / len(seeds)
            for hops, some_s in air.ages_s.items():
                ages_s.setdefault(hops, []).extend(some_s)
        found[name] = {"bytes_s_of_a_node": round(sent, 1)}
        for hops in sorted(ages_s)[:HOPS_SHOWN]:
            median_s, high_s = np.quantile(np.array(ages_s[hops]), (0.5, 0.95))
            found[name][f"{hops}_hops_median_s"] = round(float(median_s), 3)
            found[name][f"{hops}_hops_p95_s"] = round(float(high_s), 3)
    cell = Air(first_seed + 1, 16, 300.0, 0.0)
    cell.run_for(3.0)
    before = cell.sent_bytes_all()
    cell.run_for(10.0)
    found["16 nodes in one cell"] = {"bytes_s_of_all": round((cell.sent_bytes_all() - before) / 10.0, 1)}
    return found


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="first seed")
    parser.add_argument("--relay-bytes", type=float, metavar="N", help="relay_bytes_s of the broker")
    options = parser.parse_args()
    if options.relay_bytes is not None:
        Air.config = Config(relay_bytes_s=options.relay_bytes)
    found = measure(options.seed)
    if options.json:
        print(json.dumps(found))
        return
    for swarm, figures in found.items():
        print(swarm)
        for name, value in figures.items():
            print(f"  {name.replace('_', ' '):20s} {value:8.3f}")


if __name__ == "__main__":
    main()
