"""Checks an order completely before anything moves (S2.31)."""

from swarmd.mission.core.run import Run
from swarmware.errors import MissionError
from swarmware.mission.binding import Binding
from swarmware.mission.content import content_hash
from swarmware.mission.model import MissionDefinition
from swarmware.types.mission import MissionOrder


class OrderAdmission:
    """Checks orders: first what came with the mission, then, when it is read, what this platform can do."""

    def __init__(self, platform: str, kind: str) -> None:
        self._platform = platform
        self._kind = kind

    def verify(self, order: MissionOrder, now_ns: int, expires_ns: int, sender: str | None = None) -> Binding:
        """How the order's mission is to be read here.

        `expires_ns` is the order's expiry on this platform's clock; `sender` the platform that sent it, None
        where nothing proves it.
        Raises: MissionError with the reason.
        """
        # its expiry is in the issuer's time, and members answer to it: nobody orders in another's name
        if sender is not None and sender != order.issuer:
            raise MissionError(
                f"order of {order.issuer}: sent by {sender}; expected it from its issuer itself"
            )
        if now_ns > expires_ns:
            late_s = (now_ns - expires_ns) / 1e9
            raise MissionError(f"order of {order.issuer}: came {late_s:.1f} s after it had expired")
        if content_hash(order.text) != order.text_hash:
            raise MissionError(f"{order.file}: the content is not what {order.issuer} sent (hash differs)")
        if not any(member.platform == self._platform for member in order.members):
            raise MissionError(f"order of {order.issuer}: {self._platform} is not among its members")
        if len({member.platform for member in order.members}) != len(order.members):
            raise MissionError(f"order of {order.issuer}: a member is listed twice")
        return Binding(self._platform, self._kind, order.role, order.mission, order.params)

    def run(self, order: MissionOrder, mission: MissionDefinition) -> Run:
        """The order as a run of its mission, which was checked.

        Raises: MissionError when this kind of platform cannot play it.
        """
        for block in mission.blocks.values():
            if block.spec.kinds and self._kind not in block.spec.kinds:
                able = " or ".join(block.spec.kinds)
                raise MissionError(
                    f"{order.file}: {block.pointer}: a {self._kind} cannot {block.type}: expected {able}"
                )
        return Run(mission, order.mission, order.hash, order.epoch, order.role, order.members)
