"""Hover of the installed airframes in virtual time: attitude and place over minutes, for several seeds.

`python -m tests.simulation.flight.hover --seeds 20` prints the figures.
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat

import msgspec
from tests.simulation.flight.vehicle import SHARE, Flight

from swarmd.sim.config import Config as SimConfig
from swarmware.model.airframe_file import load_airframe
from swarmware.types.chassis import ChassisAction
from swarmware.types.navigation import Goal, GoalKind, NavState

HEIGHT_M = 3.0
SETTLE_S = 5.0
"""After the take-off, before it is measured."""
RARELY_DEG = 1.0


class HoverFigures(msgspec.Struct, frozen=True):
    """True attitude and position of one hover; each angle is the larger of roll and pitch."""

    airframe: str
    seed: int
    duration_s: float
    largest_deg: float
    rms_deg: float
    beyond_ratio: float
    """Share of the time beyond 1°."""
    height_m: float
    """Largest distance from the mean height."""
    place_m: float
    """Largest horizontal distance from where it began."""
    collisions: int


def risen(airframe: str, seed: int, config: SimConfig | None = None) -> Flight:
    """A flight that has taken off, and holds its place."""
    flight = Flight(airframe, seed, config)
    flight.run(2.0)
    refused = flight.order(ChassisAction.ARM)
    assert not refused, refused
    flight.goal(Goal(1, GoalKind.TAKEOFF, z_m=HEIGHT_M))
    flight.run_until(lambda f: f.status.goal_seq == 1 and f.status.state is NavState.ARRIVED, 20.0)
    flight.goal(Goal(2, GoalKind.HOLD))
    flight.run(SETTLE_S)
    return flight


def measure(airframe: str, seed: int, duration_s: float, config: SimConfig | None = None) -> HoverFigures:
    """Hovers, and measures the truth at each period of control."""
    flight = risen(airframe, seed, config)
    first = flight.truth
    tilts: list[float] = []
    heights: list[float] = []
    places: list[float] = []

    def sample(now: Flight) -> None:
        tilts.append(max(map(abs, now.tilt_deg)))
        heights.append(now.truth.z_m)
        places.append(((now.truth.x_m - first.x_m) ** 2 + (now.truth.y_m - first.y_m) ** 2) ** 0.5)

    flight.run(duration_s, sample)
    mean_m = sum(heights) / len(heights)
    return HoverFigures(
        airframe,
        seed,
        duration_s,
        max(tilts),
        (sum(tilt * tilt for tilt in tilts) / len(tilts)) ** 0.5,
        sum(tilt > RARELY_DEG for tilt in tilts) / len(tilts),
        max(abs(height - mean_m) for height in heights),
        max(places),
        len(flight.collisions),
    )


def main() -> None:
    """Prints one line for each airframe and seed, and the worst of each airframe."""
    parser = argparse.ArgumentParser(description=__doc__)
    names = sorted(path.stem for path in (SHARE / "airframes").glob("*.toml"))
    installed = [name for name in names if load_airframe(SHARE, name).type != "fixed_wing"]
    parser.add_argument("airframes", nargs="*", default=installed, help="names, all that hover by default")
    parser.add_argument("--seeds", type=int, default=2, help="number of seeds, from 1")
    parser.add_argument("--duration", type=float, default=300.0, help="seconds")
    parser.add_argument("--gusts", type=float, default=0.0, help="standard deviation of gusts in m/s")
    options = parser.parse_args()
    wind = msgspec.structs.replace(SimConfig().wind, gust_sigma_m_s=options.gusts)
    config = SimConfig(wind=wind)
    sys.stdout.write("airframe   seed  largest   rms   beyond 1°  height   place\n")
    with ProcessPoolExecutor() as pool:
        for airframe in options.airframes:
            seeds = range(1, options.seeds + 1)
            runs = pool.map(measure, repeat(airframe), seeds, repeat(options.duration), repeat(config))
            worst: list[HoverFigures] = []
            for run in runs:
                worst.append(run)
                _print(str(run.seed), run)
            _print(
                "worst",
                HoverFigures(
                    airframe,
                    0,
                    options.duration,
                    max(run.largest_deg for run in worst),
                    max(run.rms_deg for run in worst),
                    max(run.beyond_ratio for run in worst),
                    max(run.height_m for run in worst),
                    max(run.place_m for run in worst),
                    sum(run.collisions for run in worst),
                ),
            )


def _print(seed: str, run: HoverFigures) -> None:
    sys.stdout.write(
        f"{run.airframe:10} {seed:>5} {run.largest_deg:6.2f}° {run.rms_deg:5.2f}° {run.beyond_ratio:9.2%}"
        f" {run.height_m:6.2f} m {run.place_m:5.2f} m\n"
    )
    sys.stdout.flush()


if __name__ == "__main__":
    main()
