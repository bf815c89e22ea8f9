"""One run of a mission on one platform, as it was ordered."""

import msgspec

from swarmware.mission.catalogue import Barrier
from swarmware.mission.model import Mission
from swarmware.types.mission import Member


class Run(msgspec.Struct, frozen=True):
    """What is to be played, with whom."""

    mission: Mission
    name: str
    hash: str
    epoch: int
    role: str
    members: tuple[Member, ...]

    def strict_barriers(self) -> frozenset[str]:
        """Ids of barriers that name the role of a ground station: there it must be."""
        stations = {member.role for member in self.members if member.kind == "gcs"}
        params = [block.params for block in self.mission.barriers()]
        return frozenset(p.id for p in params if isinstance(p, Barrier) and stations & set(p.roles))
