"""Checks an order completely before anything moves (S2.31)."""

from swarmd.mission.core.run import Run
from swarmware.errors import InvalidInput, MissionError
from swarmware.mission.binding import Binding
from swarmware.mission.model import MissionDefinition, content_hash
from swarmware.mission.reaction import decode_rows
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import MissionOrder


def drained_text(by: str) -> str:
    """Reason for which a drained platform takes no role."""
    return f"drained by {by}; `swarmctl node undrain` ends it"


class OrderAdmission:
    """Checks orders: first the order itself, then, once its mission is read, whether this platform can play
    it."""

    def __init__(self, platform: str, kind: PlatformKind) -> None:
        self._platform = platform
        self._kind = kind

    def verify(
        self,
        order: MissionOrder,
        now_ns: int,
        expires_ns: int,
        sender: str | None = None,
        drained_by: str = "",
    ) -> Binding:
        """Checks an order; returns the binding with which its mission is read here.

        `expires_ns` is the order's expiry on this platform's clock; `sender` is the platform that sent it,
        None where it is not authenticated; `drained_by` the operator who drained this platform.
        Raises: MissionError with the reason.
        """
        if drained_by:
            raise MissionError(drained_text(drained_by))
        # the expiry is on the issuer's clock, and members reply to the issuer: it must be the sender
        if sender is not None and sender != order.issuer:
            raise MissionError(
                f"order of {order.issuer}: sent by {sender}; expected it from its issuer itself"
            )
        if now_ns > expires_ns:
            late_s = (now_ns - expires_ns) / 1e9
            raise MissionError(f"order of {order.issuer}: arrived {late_s:.1f} s after its expiry")
        if content_hash(order.text) != order.text_hash:
            raise MissionError(f"{order.file}: the content is not what {order.issuer} sent (hash differs)")
        if not any(member.platform == self._platform for member in order.members):
            raise MissionError(f"order of {order.issuer}: {self._platform} is not among its members")
        if len({member.platform for member in order.members}) != len(order.members):
            raise MissionError(f"order of {order.issuer}: a member is listed twice")
        return Binding(self._platform, self._kind, order.role, order.mission, order.params)

    def run(self, order: MissionOrder, mission: MissionDefinition) -> Run:
        """The run of an order whose mission was checked.

        Raises: MissionError when this kind of platform cannot play it.
        """
        for block in mission.blocks.values():
            if block.spec.kinds and self._kind not in block.spec.kinds:
                able = " or ".join(block.spec.kinds)
                raise MissionError(
                    f"{order.file}: {block.pointer}: a {self._kind} cannot {block.type}: expected {able}"
                )
        try:
            rows = decode_rows(order.reactions)
        except InvalidInput as error:
            raise MissionError(f"order of {order.issuer}: {error}") from error
        return Run(
            mission, order.mission, order.hash, order.epoch, order.role, order.members, rows, order.priority
        )
