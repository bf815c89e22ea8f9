"""Model of a radio: rate and loss over distance or time, airtime, queues and delays."""

from bisect import bisect_right
from enum import StrEnum
from typing import Annotated, Final

import msgspec

from swarmware.errors import InvalidInput

Seconds = Annotated[float, msgspec.Meta(ge=0, le=10)]
Metres = Annotated[float, msgspec.Meta(ge=-100_000, le=100_000)]
Distance = Annotated[float, msgspec.Meta(ge=0, le=1_000_000)]
Ratio = Annotated[float, msgspec.Meta(ge=0, le=1)]
BitRate = Annotated[float, msgspec.Meta(ge=1000, le=1e11)]

OUT_OF_RANGE: Final = 1.0
"""Loss of a link that carries nothing."""


class CurvePoint(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Rate and loss of a link at one distance."""

    distance_m: Distance
    rate_bit_s: BitRate
    """Rate of unicast frames, in bit/s."""
    loss_ratio: Ratio
    """Loss of one transmission, before it is repeated."""


class TracePoint(msgspec.Struct, frozen=True, kw_only=True):
    """One row of a recorded link."""

    time_s: Annotated[float, msgspec.Meta(ge=0)]
    """Time since the start of the recording."""
    distance_m: Distance
    rate_bit_s: BitRate
    """Measured rate in bit/s."""
    loss_ratio: Ratio


class TraceAxis(StrEnum):
    """The column of a recorded link by which its rows are found."""

    DISTANCE = "distance"
    TIME = "time"


class TraceFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A recorded link that replaces the curves."""

    file: Annotated[str, msgspec.Meta(min_length=1)]
    """CSV file with the columns time_s, distance_m, rate_bit_s and loss_ratio; relative to the radio file."""
    by: TraceAxis = TraceAxis.DISTANCE


class RadioModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A radio file: share/swarm/radios/<name>.toml."""

    description: str
    multicast_rate_bit_s: BitRate
    """Rate of multicast and broadcast frames, in bit/s; without curves of all frames."""
    overhead_s: Seconds = 0.0
    """Airtime of a transmission besides its bytes: preamble, contention, acknowledgement."""
    retries: Annotated[int, msgspec.Meta(ge=0, le=20)] = 0
    """Maximum repetitions of a unicast frame; multicast frames are not repeated."""
    delay_s: Seconds = 0.0
    """Delay of a frame after its transmission."""
    jitter_s: Seconds = 0.0
    """Maximum additional delay, uniformly distributed; frames of a link stay in order."""
    queue_bytes: Annotated[int, msgspec.Meta(ge=2000, le=100_000_000)] = 200_000
    """Transmit queue of each node; a frame that does not fit is dropped."""
    shared_air: bool = True
    """Whether nodes in range of each other transmit one after the other."""
    station_m: tuple[Metres, Metres, Metres] = (0.0, 0.0, 2.0)
    """Position of nodes without a vehicle, and of vehicles before their first pose: x, y, z."""
    ground: tuple[CurvePoint, ...] = ()
    """Curve of links between nodes on the ground; out of range beyond its last point."""
    air: tuple[CurvePoint, ...] = ()
    """Curve of links of which an end flies."""
    trace: TraceFile | None = None

    def __post_init__(self) -> None:
        for name, curve in (("ground", self.ground), ("air", self.air)):
            distances = [point.distance_m for point in curve]
            if sorted(set(distances)) != distances:
                raise InvalidInput(f"{name}: distances {distances}; expected ascending ones")
        # one curve alone would give the other kind of links an unlimited range
        if bool(self.ground) != bool(self.air):
            raise InvalidInput("ground, air: only one has points; expected both, or neither (no limit)")
        if self.trace is not None and self.ground:
            raise InvalidInput("trace: replaces the curves; expected no ground and air")


class RadioQuality(msgspec.Struct, frozen=True):
    """Quality of a link at one instant."""

    distance_m: float
    rate_bit_s: float
    """Rate of unicast frames, in bit/s."""
    loss_ratio: float
    """Loss of one transmission."""

    @property
    def in_range(self) -> bool:
        """Whether any frame can arrive."""
        return self.loss_ratio < OUT_OF_RANGE


class Propagation:
    """Quality of links by distance and time, from the curves of a model or a recorded link."""

    def __init__(self, model: RadioModel, trace: tuple[TracePoint, ...] = ()) -> None:
        self._plain_rate_bit_s = model.multicast_rate_bit_s
        self._by_time = trace if model.trace is not None and model.trace.by == TraceAxis.TIME else ()
        self._times_s = [row.time_s for row in self._by_time]
        recorded = () if self._by_time else _curve(trace)
        self._ground = recorded or model.ground
        self._air = recorded or model.air

    def quality(self, distance_m: float, elapsed_s: float, *, flies: bool) -> RadioQuality:
        """Quality of a link of this length; `flies`: one of its ends does; `elapsed_s`: since the start."""
        if self._by_time:
            # the last row stays in force after the end of the recording
            row = self._by_time[max(0, bisect_right(self._times_s, elapsed_s) - 1)]
            return RadioQuality(distance_m, row.rate_bit_s, row.loss_ratio)
        curve = self._air if flies else self._ground
        if not curve:
            return RadioQuality(distance_m, self._plain_rate_bit_s, 0.0)
        return _at(curve, distance_m)


def _curve(trace: tuple[TracePoint, ...]) -> tuple[CurvePoint, ...]:
    """The recorded rows by distance; of rows with the same distance the mean."""
    rows: dict[float, list[TracePoint]] = {}
    for row in trace:
        rows.setdefault(row.distance_m, []).append(row)
    return tuple(
        CurvePoint(
            distance_m=distance_m,
            rate_bit_s=sum(row.rate_bit_s for row in same) / len(same),
            loss_ratio=sum(row.loss_ratio for row in same) / len(same),
        )
        for distance_m, same in sorted(rows.items())
    )


def _at(curve: tuple[CurvePoint, ...], distance_m: float) -> RadioQuality:
    after = bisect_right(curve, distance_m, key=lambda point: point.distance_m)
    if after == 0:
        return RadioQuality(distance_m, curve[0].rate_bit_s, curve[0].loss_ratio)
    near = curve[after - 1]
    # beyond the last point nothing arrives, at the point itself its own loss holds
    if after == len(curve):
        loss = near.loss_ratio if distance_m == near.distance_m else OUT_OF_RANGE
        return RadioQuality(distance_m, near.rate_bit_s, loss)
    far = curve[after]
    share = (distance_m - near.distance_m) / (far.distance_m - near.distance_m)
    return RadioQuality(
        distance_m,
        near.rate_bit_s + share * (far.rate_bit_s - near.rate_bit_s),
        near.loss_ratio + share * (far.loss_ratio - near.loss_ratio),
    )
