"""Two paths of a vehicle and their distance over time, as a picture; imports matplotlib."""

import io

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from swarmlab.measure.tracks import Floats, VehicleTrack
from swarmlab.report.plots import DPI, STYLE


def draw(
    paths: dict[str, tuple[VehicleTrack, VehicleTrack]], distances: dict[str, tuple[Floats, Floats]]
) -> bytes:
    """PNG of the lumped and the distributed path of each vehicle, and of their distances."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 8), layout="constrained")
        FigureCanvasAgg(figure)
        world, below = figure.subplots(2, 1, height_ratios=[3, 1])
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
        png = io.BytesIO()
        figure.savefig(png, format="png", dpi=DPI)
        return png.getvalue()
