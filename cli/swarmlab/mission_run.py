"""Course of one mission as the lab sees it: complete at any moment from the command on, however it ends."""

import time

from swarmctl.labs import LabState
from swarmlab import host, load
from swarmlab.host import CpuTime
from swarmlab.load import Usage
from swarmlab.watch import MissionMembers, MissionOutcome
from swarmware.types.mission import TaskAnswer


class MissionRun:
    """One mission from the command to its end."""

    def __init__(self) -> None:
        self.command_mono_ns = 0
        """True time of the command; 0: it was not given."""
        self.end_mono_ns = 0
        self.answer: TaskAnswer | None = None
        self.members = MissionMembers((), 0)
        self.in_time = True
        self.error = ""
        """What broke it off; empty: it went on to the end of the mission or of the time."""
        self.before: dict[str, Usage] = {}
        self.after: dict[str, Usage] = {}
        self.busy: tuple[CpuTime, CpuTime]
        """The whole computer, at the same two instants."""

    def command(self) -> None:
        """The command leaves now."""
        self.command_mono_ns = time.monotonic_ns()

    def commanded(self, lab: LabState) -> None:
        """The answer is there, or will not come; not earlier: a look at all processes delays the command."""
        self.before = load.usage(lab)
        self.busy = (host.busy(), host.busy())

    def accepted(self, answer: TaskAnswer) -> None:
        """These members play it."""
        self.members = MissionMembers([order.platform for order in answer.orders], answer.epoch)

    def close(self, lab: LabState) -> None:
        """Nothing is seen of it after this moment."""
        self.end_mono_ns = time.monotonic_ns()
        self.after = load.usage(lab)
        self.busy = (self.busy[0], host.busy())

    @property
    def outcome(self) -> MissionOutcome:
        """As far as it is known."""
        return self.members.outcome(in_time=self.in_time)

    def failure(self) -> str:
        """Why it was not completed, for people; empty when it was."""
        return self.error or self.outcome.failure()

    def percent(self, platform: str) -> float | None:
        """Share of one core that the node's processes used; None when it is not known."""
        if platform not in self.before or platform not in self.after:
            return None
        return load.percent(self.before[platform], self.after[platform])
