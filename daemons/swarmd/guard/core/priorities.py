"""Priorities and cores of the processes of services, by measured load (S1.84)."""

from collections.abc import Iterable
from typing import Final, NamedTuple

import msgspec

PRESSED_RATIO: Final = 0.85
"""Use of all cores above which processes wait for each other, and priorities are set."""
RELAXED_RATIO: Final = 0.7
"""Use of all cores below which priorities are reset; lower than `PRESSED_RATIO` for hysteresis."""
PRESSED_NS: Final = 3_000_000_000
"""Duration of high use before priorities are set; the start of the services is shorter."""
RELAXED_NS: Final = 10_000_000_000
"""Duration of low use before all priorities are reset."""
HEAVY_PERCENT: Final = 25.0
"""Share of one core above which a process counts as heavy and can be demoted."""
LATE_MS: Final = 20.0
"""Lateness of an event loop that would delay a control step of 50 ms; without load it is below 5 ms."""
SAMPLES: Final = 3
"""Consecutive samples after which a process counts as heavy or late."""
DEMOTED: Final = 5
"""Niceness of a heavy process, a third of the weight of niceness 0 (sched(7): factor 1.25 per step)."""
PROMOTED: Final = -5
"""Niceness of a process that is late and not heavy."""
NEVER_DEMOTED: Final = frozenset({"guard", "health", "broker", "hal", "control"})
"""Services on which other services and the motors depend."""


class ServiceLoad(NamedTuple):
    """Load of one service in the last second."""

    name: str
    pid: int
    cpu_percent: float
    """Processor time of its process, as a share of one core."""
    late_ms: float
    """Largest lateness of its event loop."""


class ProcessPriority(NamedTuple):
    """Niceness of a process, and the cores on which it runs."""

    nice: int = 0
    cores: tuple[int, ...] = ()
    """Cores on which the process runs, or () for all cores."""


class SetPriority(msgspec.Struct, frozen=True):
    """Action: set the priority of a process."""

    name: str
    pid: int
    priority: ProcessPriority


class _Process:
    __slots__ = ("heavy", "late", "pid", "priority")

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.priority = ProcessPriority()
        self.heavy = 0
        """Consecutive samples in which the process was heavy."""
        self.late = 0


class PriorityCore:
    """Decides priorities: while the processor is overloaded, heavy processes yield to late processes.

    A priority stays until the load has been low for a while. Otherwise a process that is light only because
    it yields would get its priority back at once.
    """

    def __init__(self, cores: tuple[int, ...], lowest_nice: int) -> None:
        """`lowest_nice`: lowest niceness that may be set; above 0 a niceness is irreversible, and only cores
        are set."""
        self._cores = cores
        self._lowest_nice = lowest_nice
        self._processes: dict[str, _Process] = {}
        self._pressed = False
        self._since_ns: int | None = None
        """Instant since which the use of the processor calls for the other state."""

    @property
    def pressed(self) -> bool:
        """True while the processor is overloaded."""
        return self._pressed

    def of(self, name: str) -> ProcessPriority:
        """The priority of a service."""
        process = self._processes.get(name)
        return ProcessPriority() if process is None else process.priority

    def on_found(self, name: str, pid: int, priority: ProcessPriority) -> None:
        """Takes a priority that the previous guard has set for a process."""
        process = self._processes[name] = _Process(pid)
        process.priority = priority

    def on_refused(self, name: str) -> None:
        """Takes a refusal by the system; no priority is set again for this process."""
        if (process := self._processes.get(name)) is not None:
            process.priority = ProcessPriority()
            # counts up without ever reaching SAMPLES
            process.heavy = process.late = -(1 << 62)

    def on_loads(self, busy_ratio: float, loads: Iterable[ServiceLoad], now_ns: int) -> list[SetPriority]:
        """Takes a sample of the load of the computer and of each service; returns the priorities to set."""
        self._judge(busy_ratio, now_ns)
        actions = []
        seen = set()
        for load in loads:
            seen.add(load.name)
            process = self._processes.get(load.name)
            if process is None or process.pid != load.pid:
                process = self._processes[load.name] = _Process(
                    load.pid
                )  # a new process starts with the default priority
            heavy = load.cpu_percent >= HEAVY_PERCENT
            # a negative count is a refused process, which must not be reset to 0
            process.heavy = process.heavy + 1 if heavy or process.heavy < 0 else 0
            process.late = process.late + 1 if load.late_ms >= LATE_MS or process.late < 0 else 0
            wanted = self._wanted(load.name, process)
            if wanted != process.priority:
                process.priority = wanted
                actions.append(SetPriority(load.name, load.pid, wanted))
        for name in self._processes.keys() - seen:
            del self._processes[name]
        return actions

    def _judge(self, busy_ratio: float, now_ns: int) -> None:
        other = busy_ratio <= RELAXED_RATIO if self._pressed else busy_ratio >= PRESSED_RATIO
        if not other:
            self._since_ns = None
            return
        if self._since_ns is None:
            self._since_ns = now_ns
        if now_ns - self._since_ns >= (RELAXED_NS if self._pressed else PRESSED_NS):
            self._pressed, self._since_ns = not self._pressed, None

    def _wanted(self, name: str, process: _Process) -> ProcessPriority:
        if not self._pressed:
            return ProcessPriority()
        if process.priority != ProcessPriority():
            return process.priority
        reversible = self._lowest_nice <= 0
        if process.heavy >= SAMPLES and name not in NEVER_DEMOTED:
            # the first core stays free of heavy processes
            return ProcessPriority(DEMOTED if reversible else 0, self._cores[1:])
        if process.late >= SAMPLES and process.heavy <= 0 and reversible:
            return ProcessPriority(max(PROMOTED, self._lowest_nice))
        return ProcessPriority()
