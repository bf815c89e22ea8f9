"""Steps of a mission and a member that carries them out."""

from typing import Any

from tests.unit.mission.nets import net
from tests.unit.mission.results import result

from swarmd.mission.config import Config
from swarmd.mission.core.run import CancelBlock, ProgressStep, Run, StartBlock
from swarmd.mission.core.scheduler import MissionScheduler
from swarmware.mission.binding import Binding
from swarmware.mission.field_path import Scalar
from swarmware.mission.loader import load
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import Member

S = 1_000_000_000


LAND = load(net(s="Start>land", land={"type": "Land", "next": "e"}, e="End"), "land", Binding())


HOLD = load(net(s="Start>hold", hold={"type": "Hold", "next": "e"}, e="End"), "hold", Binding())


ARM = net(s="Start>a", a={"type": "Arm", "next": "e", "timeout_s": 5}, e="End")


A, B = Member("a", "x", PlatformKind.UAV), Member("b", "x", PlatformKind.UAV)


class Values:
    """A battery."""

    def __init__(self) -> None:
        self.battery: float | None = 1.0
        self.pose_age_s: float | None = 0.0

    def value(self, path: str, field: str) -> Scalar | None:
        return self.battery

    def age_s(self, path: str) -> float | None:
        return self.pose_age_s


class Member1:
    """A core and the words for what it does."""

    def __init__(self, kind: str = "uav") -> None:
        self.values = Values()
        built_in = {"land": LAND, "hold": HOLD} if kind != "gcs" else {}
        self.core = MissionScheduler("a", built_in, self.values, lambda: 0.0, Config(), lambda _: S // 4)

    def order(
        self,
        text: str = ARM,
        members: tuple[Member, ...] = (A,),
        now: int = 0,
        name: str = "hop",
        epoch: int = 7,
        priority: int = 0,
    ) -> list[str]:
        mission = load(text, "m.json", Binding())
        run = Run(mission, name, "0123456789", epoch, "x", members, priority=priority, by="anna@gcs")
        return words(self.core.on_order(run, now))

    def ended(self, token: int, word: str = "ok", now: int = S) -> list[str]:
        """The shell reports the end of a block."""
        return words(self.core.on_ended(token, result(word), "", now))

    def queue(self) -> dict[str, str]:
        """State of each run of the queue, in its order."""
        return {one.mission: one.state for one in self.core.queue()}

    @property
    def phase(self) -> str:
        return self.core.phase.value


def words(actions: list[Any]) -> list[str]:
    found: list[str] = []
    for action in actions:
        match action:
            case StartBlock(token, block):
                found.append(f"start {block.id} {token}")
            case CancelBlock(token):
                found.append(f"cancel {token}")
            case ProgressStep("", _, event):
                found.append(event)
    return found
