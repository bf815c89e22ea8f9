"""One mission as observed by the lab; its data are complete at any instant after the command."""

import time

from swarmctl.session.labs import LabState
from swarmlab.measure import host, load
from swarmlab.measure.load import Usage
from swarmlab.run.watch import MissionMembers, MissionOutcome
from swarmware.types.mission import TaskAnswer


class MissionRun:
    """One mission from the command to its end."""

    def __init__(self) -> None:
        self.command_mono_ns = 0
        """True time of the command, or 0 if it was not given."""
        self.end_mono_ns = 0
        self.answer: TaskAnswer | None = None
        self.members = MissionMembers((), 0)
        self.in_time = True
        self.error = ""
        """Error that ended the run early, or "" if it ran to its end or its time-out."""
        self.before: dict[str, Usage] = {}
        self.after: dict[str, Usage] = {}
        now = host.busy()
        self.busy = (now, now)
        """Processor time of the whole computer at the same two instants."""

    def command(self) -> None:
        """Notes the instant of the command."""
        self.command_mono_ns = time.monotonic_ns()

    def commanded(self, lab: LabState) -> None:
        """Samples processor time, after the answer: a scan of all processes would delay the command."""
        self.before = load.usage(lab)
        self.busy = (host.busy(), host.busy())

    def accepted(self, answer: TaskAnswer) -> None:
        """Note the members that accepted the mission."""
        self.members = MissionMembers([order.platform for order in answer.orders], answer.epoch)

    def close(self, lab: LabState) -> None:
        """Records the end; later events are ignored."""
        self.end_mono_ns = time.monotonic_ns()
        self.after = load.usage(lab)
        self.busy = (self.busy[0], host.busy())

    @property
    def outcome(self) -> MissionOutcome:
        """The outcome as far as known."""
        return self.members.outcome(in_time=self.in_time)

    def failure(self) -> str:
        """Why the mission was not completed, or "" if it was."""
        return self.error or self.outcome.failure()

    def percent(self, platform: str) -> float | None:
        """Share of one core that the node's processes used, or None if it is not known."""
        # without the command, or with a node that ended, there is no span to compare
        if platform not in self.before or platform not in self.after:
            return None
        return load.percent(self.before[platform], self.after[platform])
