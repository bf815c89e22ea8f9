"""The flight as data of the page: positions on one time axis, in centimetres, as differences."""

import json
import math
from typing import Final

import numpy as np

from swarmlab.measure import tracks
from swarmlab.measure.tracks import Floats, VehicleTrack
from swarmlab.report.plot_data import PlotData

STEP_MS: Final = 100
"""Distance of two instants; doubled until all positions fit into `MAX_POSITIONS`."""
MAX_POSITIONS: Final = 60_000
"""About 0.6 MB."""


def step_ms(data: PlotData) -> int:
    """Distance of two instants of the replay."""
    found = STEP_MS
    while data.duration_s * 1000 / found * max(1, len(data.tracks)) > MAX_POSITIONS:
        found *= 2
    return found


def encoded(data: PlotData) -> str:
    """JSON text that is safe within a script element.

    `step_ms` is the distance of two instants, the first is 0. A vehicle has `pieces` without holes: `at` is
    the index of the first instant; `x`, `y`, `z` in cm and `h` (heading, degrees counter-clockwise from east)
    begin with a value, each further number is the difference from the one before. `blocks` are
    [start ms, end ms, name].
    """
    step = step_ms(data)
    axis = tracks.axis(0.0, data.duration_s, 1000 / step)
    document = {
        "step_ms": step,
        "count": len(axis),
        "end_ms": round(data.duration_s * 1000),
        "vehicles": [
            {
                "name": name,
                "kind": data.kinds[name],
                "pieces": _pieces(track, axis),
                "blocks": [
                    [round(span.start_s * 1000), round(span.end_s * 1000), span.block.removeprefix("@")]
                    for span in (data.timelines[name].spans if name in data.timelines else ())
                ],
            }
            for name, track in data.tracks.items()
        ],
    }
    # a name with `</script>` in it would end the element
    return json.dumps(document, separators=(",", ":")).replace("<", "\\u003c")


def _pieces(track: VehicleTrack, axis: Floats) -> list[dict[str, int | list[int]]]:
    cm = np.round(tracks.resample(track, axis) * 100)
    heading = np.round(tracks.resample_yaw(track, axis) * 180 / math.pi)
    found: list[dict[str, int | list[int]]] = []
    # pieces, since JSON has no NaN for the holes of a recording
    for start, stop in tracks.runs(np.asarray(np.isfinite(cm).all(axis=1))):
        columns = {
            "x": cm[start:stop, 0],
            "y": cm[start:stop, 1],
            "z": cm[start:stop, 2],
            "h": heading[start:stop],
        }
        found.append({"at": start, **{key: _differences(values) for key, values in columns.items()}})
    return found


def _differences(values: Floats) -> list[int]:
    # small numbers make the page a fraction of its size, and integers do not add up errors
    return [int(value) for value in np.diff(values, prepend=0.0)]
