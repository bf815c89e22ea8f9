"""Verdicts on the placement of applications on the computers of a platform, from measurements (S1.14–17)."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, Literal

import msgspec

from swarmware.types.driver import LineLoad
from swarmware.types.placement import PlacedApplication, RemoteInput, UnitPlacement

CAPACITY_RATIO: Final = 0.8
"""Share of a computer's cores above which values wait for the processor: in an M/M/1 queue at 80 % the mean
time is five times that without load (Kleinrock 1975, Queueing Systems, section 3.2)."""
BANDWIDTH_RATIO: Final = 0.5
"""Share of a link that values between two computers may take: the other half is for commands, retransmissions
and the beacons of others."""
COMMUNICATION_RATIO: Final = 0.2
"""Share of a computer's cores that its communication layer may take: above it a lumped module saves more than
a second computer brings."""
OVERHEAD_BYTES: Final = 48 + 40 + 20
"""Header of a frame, of TCP and IP, and of the notification, per value; several values share them."""
COMMUNICATION: Final = frozenset({"broker", "tree", "register", "timesync"})
"""Services of the communication layer."""
BASIS: Final = COMMUNICATION | {"health", "guard", "logger"}
"""Services that each computer has."""

Verdict = Literal["separable", "together", "separate", "here"]


class InputVerdict(msgspec.Struct, frozen=True):
    """Whether an application may have this input from another computer."""

    path: str
    unit: str
    """Computer that provides it."""
    applications: tuple[str, ...]
    delay_mean_ms: float | None
    delay_p95_ms: float | None
    """Delay of nineteen values in twenty, by which it is judged: single late values are jitter."""
    delay_worst_ms: float | None
    needed_ms: float | None
    """Longest delay that a reader states to need, or age above which the owner declares a value stale; null
    if neither is stated, and the delay is not judged."""
    received_hz: float
    bytes_s: float
    late: bool


class LinkLoad(msgspec.Struct, frozen=True):
    """Values from one computer of the platform to another."""

    sender: str
    receiver: str
    bytes_s: float
    """Bytes per second including headers."""
    rate_bit_s: float | None
    """Rate of its medium, as stated, configured or measured; null if it is unknown, and not judged."""
    limit_bytes_s: float | None
    exceeded: bool


class UnitLoad(msgspec.Struct, frozen=True):
    """Load of one computer of the platform."""

    unit: str
    cores: int
    busy_percent: float
    """Share of all its cores."""
    free_percent: float
    communication_percent: float | None
    """Share of all its cores that the communication layer takes, or null in a shared process."""
    interfaces: int
    over_capacity: bool


class LineVerdict(msgspec.Struct, frozen=True):
    """Whether a line or bus carries what the drivers ask of it."""

    device: str
    drivers: tuple[str, ...]
    asked_bit_s: float
    capacity_bit_s: float
    """0: not known."""
    over_capacity: bool


class ModuleVerdict(msgspec.Struct, frozen=True):
    """Verdict on the place of one application."""

    unit: str
    application: str
    verdict: Verdict
    """separable: it may have its own computer; together: it must run where its input is provided; separate:
    its computer is over capacity; here: it has no input of another computer, so nothing was measured."""
    reason: str


class PlacementReport(msgspec.Struct, frozen=True):
    """Measured placement of a platform, judged."""

    platform: str
    window_s: float
    units: list[UnitLoad]
    inputs: list[InputVerdict]
    links: list[LinkLoad]
    modules: list[ModuleVerdict]
    silent: list[str]
    """Computers that did not answer."""
    lines: list[LineVerdict] = []
    """Lines and buses to the devices of the platform."""

    @property
    def objections(self) -> bool:
        """Whether an application or a device should be placed elsewhere."""
        moved = any(module.verdict in {"together", "separate"} for module in self.modules)
        return moved or any(line.over_capacity for line in self.lines)


def judge(
    platform: str,
    measured: Sequence[UnitPlacement],
    stated_bit_s: float | None = None,
    silent: Iterable[str] = (),
    lines: Iterable[LineLoad] = (),
) -> PlacementReport:
    """The verdicts; `stated_bit_s`: rate of the links between the computers, in place of what they report."""
    inputs = [_input(unit, one) for unit in measured for one in unit.inputs]
    links = list(_links(measured, stated_bit_s))
    units = [_load(unit) for unit in measured]
    modules = [
        verdict
        for unit, load in zip(measured, units, strict=True)
        for verdict in _modules(unit, load, links, len(measured) > 1)
    ]
    window_s = max((unit.window_s for unit in measured), default=0.0)
    judged = [_line(line) for line in lines]
    return PlacementReport(platform, window_s, units, inputs, links, modules, sorted(silent), judged)


def _line(line: LineLoad) -> LineVerdict:
    limit = CAPACITY_RATIO * line.capacity_bit_s
    return LineVerdict(
        line.device, line.drivers, line.asked_bit_s, line.capacity_bit_s, 0 < limit < line.asked_bit_s
    )


def _input(unit: UnitPlacement, one: RemoteInput) -> InputVerdict:
    return InputVerdict(
        one.path,
        one.unit,
        one.applications,
        one.delay_mean_ms,
        one.delay_p95_ms,
        one.delay_worst_ms,
        one.within_s * 1e3 or None,
        round(one.values / unit.window_s, 2),
        round(one.payload_bytes / unit.window_s, 1),
        _late(one),
    )


def _late(one: RemoteInput) -> bool:
    return one.delay_p95_ms is not None and 0 < one.within_s * 1e3 < one.delay_p95_ms


def _links(measured: Sequence[UnitPlacement], stated_bit_s: float | None) -> Iterator[LinkLoad]:
    rates = {unit.unit: unit.rates_bit_s for unit in measured}
    for receiver in measured:
        sent: dict[str, float] = defaultdict(float)
        for one in receiver.inputs:
            # counted at the receiver: only it knows what of the sender's values it gets
            sent[one.unit] += (one.payload_bytes + one.values * OVERHEAD_BYTES) / receiver.window_s
        for sender, found in sorted(sent.items()):
            rate_bit_s = stated_bit_s or rates.get(sender, {}).get(receiver.unit)
            limit = rate_bit_s / 8 * BANDWIDTH_RATIO if rate_bit_s else None
            exceeded = limit is not None and found > limit
            yield LinkLoad(sender, receiver.unit, round(found, 1), rate_bit_s, limit, exceeded)


def _load(unit: UnitPlacement) -> UnitLoad:
    busy = unit.busy_percent / unit.cores
    found = _communication(unit)
    return UnitLoad(
        unit.unit,
        unit.cores,
        round(busy, 1),
        round(max(0.0, 100 - busy), 1),
        None if found is None else round(found / unit.cores, 1),
        sum(application.interfaces for application in unit.applications),
        busy > CAPACITY_RATIO * 100,
    )


def _communication(unit: UnitPlacement) -> float | None:
    """Processor time of the communication layer as a share of one core, or None if other code shares it."""
    own = [one for one in unit.applications if one.name in COMMUNICATION]
    # the processor time of a process with several services cannot be divided
    if not own or any(one.in_process > 1 for one in own):
        return None
    return sum(one.cpu_percent for one in own)


def _modules(
    unit: UnitPlacement, load: UnitLoad, links: Sequence[LinkLoad], several: bool
) -> Iterator[ModuleVerdict]:
    modules = [one for one in unit.applications if one.name not in BASIS]
    heaviest = max(modules, key=lambda one: one.cpu_percent, default=None)
    for one in modules:
        found = _of_inputs(one, unit, load, links) if several else None
        free = found is None or found[0] == "separable"
        # moving the heaviest frees most; a single module has no other to be separated from
        if free and load.over_capacity and one is heaviest and len(modules) > 1:
            text = f"{unit.unit}: {load.busy_percent:.0f} % of its cores busy; at most {CAPACITY_RATIO:.0%}"
            found = "separate", text
        verdict, reason = found or ("here", "no input of another computer")
        yield ModuleVerdict(unit.unit, one.name, verdict, reason)


def _of_inputs(
    module: PlacedApplication, unit: UnitPlacement, load: UnitLoad, links: Sequence[LinkLoad]
) -> tuple[Verdict, str] | None:
    """Verdict by the inputs from other computers, or None without such an input."""
    inputs = [one for one in unit.inputs if module.name in one.applications]
    if not inputs:
        return None
    for one in inputs:
        if _late(one):
            return "together", (
                f"with {one.unit}: {one.path} after {one.delay_p95_ms:.1f} ms,"
                f" needed within {one.within_s * 1e3:.1f} ms"
            )
    senders = {one.unit for one in inputs}
    for link in links:
        if link.exceeded and link.receiver == unit.unit and link.sender in senders and link.rate_bit_s:
            return "together", (
                f"with {link.sender}: {link.bytes_s * 8 / 1e3:.0f} kbit/s,"
                f" at most {BANDWIDTH_RATIO:.0%} of {link.rate_bit_s / 1e3:.0f} kbit/s"
            )
    share = load.communication_percent
    if share is not None and share > COMMUNICATION_RATIO * 100:
        return "together", (
            f"with {', '.join(sorted(senders))}: communication takes {share:.0f} % of {unit.unit},"
            f" accepted {COMMUNICATION_RATIO:.0%}"
        )
    worst_ms = max((one.delay_worst_ms for one in inputs if one.delay_worst_ms is not None), default=None)
    if worst_ms is None:
        return "separable", "no value arrived in the window"
    known = all(link.rate_bit_s for link in links if link.receiver == unit.unit and link.sender in senders)
    return "separable", f"delays at most {worst_ms:.1f} ms" + ("" if known else "; rate of the link unknown")
