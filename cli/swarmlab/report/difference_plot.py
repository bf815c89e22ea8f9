"""Two paths of a vehicle and their distance over time, as a picture; imports matplotlib."""

import io
from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from swarmlab.measure.tracks import Floats, VehicleTrack
from swarmlab.report.plots import DPI, STYLE


def draw(
    paths: dict[str, tuple[VehicleTrack, VehicleTrack]],
    distances: dict[str, tuple[Floats, Floats]],
    delays_ms: Mapping[str, Sequence[float]],
) -> bytes:
    """PNG of the lumped and the distributed path of each vehicle, of their distances, and of the delays."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 10), layout="constrained")
        FigureCanvasAgg(figure)
        world, below, delays = figure.subplots(3, 1, height_ratios=[3, 1, 1])
        world.set_title("Paths: lumped (wide) and distributed (narrow)")
        world.set_aspect("equal", adjustable="datalim")
        world.set_xlabel("east, m")
        world.set_ylabel("north, m")
        below.set_title("Distance of the lumped path to the distributed one")
        below.set_xlabel("s since the command")
        below.set_ylabel("m")
        for name, (lumped, distributed) in paths.items():
            (line,) = world.plot(lumped.xyz_m[:, 0], lumped.xyz_m[:, 1], linewidth=4, alpha=0.35)
            world.plot(
                distributed.xyz_m[:, 0],
                distributed.xyz_m[:, 1],
                linewidth=1,
                color=line.get_color(),
                label=name,
            )
            times_s, distance_m = distances[name]
            below.plot(times_s, distance_m, linewidth=1, color=line.get_color(), label=name)
        if paths:
            world.legend()
        delays.set_title("Share of the values of an input that were used within a delay, distributed")
        delays.set_xlabel("ms from stamp to use")
        for name, found in delays_ms.items():
            ordered = np.sort(found)
            share = np.arange(1, len(ordered) + 1) / len(ordered)
            delays.plot(ordered, share, linewidth=1, label=f"{name}: mean {ordered.mean():.1f} ms")
        if delays_ms:
            delays.legend()
        png = io.BytesIO()
        figure.savefig(png, format="png", dpi=DPI)
        return png.getvalue()
