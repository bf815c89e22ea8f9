"""May this order be played here? Everything that can be checked is, before anything moves (S2.31)."""

from swarmd.mission.core.run import Run
from swarmware.errors import MissionError
from swarmware.mission.binding import Binding
from swarmware.mission.catalogue import Catalogue
from swarmware.mission.check import check_text
from swarmware.mission.finding import sound
from swarmware.mission.folder import content_hash
from swarmware.mission.model import Mission
from swarmware.types.mission import MissionOrder


class Admission:
    """Checks orders; the same text with the same parameters is checked once."""

    def __init__(self, platform: str, kind: str, catalogue: Catalogue) -> None:
        self._platform = platform
        self._kind = kind
        self._catalogue = catalogue
        self._last: tuple[str, Binding, Mission] | None = None

    def run(self, order: MissionOrder, now_ns: int, expires_ns: int) -> Run:
        """The order as a run.

        `expires_ns` is the order's expiry on this platform's clock.
        Raises: MissionError with all reasons, one a line.
        """
        if now_ns > expires_ns:
            late_s = (now_ns - expires_ns) / 1e9
            raise MissionError(f"order of {order.issuer}: came {late_s:.1f} s after it had expired")
        if content_hash(order.text) != order.text_hash:
            raise MissionError(f"{order.file}: the content is not what {order.issuer} sent (hash differs)")
        if not any(member.platform == self._platform for member in order.members):
            raise MissionError(f"order of {order.issuer}: {self._platform} is not among its members")
        if len({member.platform for member in order.members}) != len(order.members):
            raise MissionError(f"order of {order.issuer}: a member stands there twice")
        mission = self._mission(order)
        return Run(mission, order.mission, order.hash, order.epoch, order.role, order.members)

    def _mission(self, order: MissionOrder) -> Mission:
        binding = Binding(self._platform, self._kind, order.role, order.mission, order.params)
        if self._last is not None and self._last[:2] == (order.text_hash, binding):
            return self._last[2]
        reading, findings = check_text(order.text, order.file, binding, self._catalogue)
        mission = reading.mission
        if mission is None or not sound(findings):
            raise MissionError("\n".join(str(f) for f in findings if f.severity != "warning"))
        for block in mission.blocks.values():
            if block.spec.kinds and self._kind not in block.spec.kinds:
                able = " or ".join(block.spec.kinds)
                raise MissionError(
                    f"{order.file}: {block.pointer}: a {self._kind} cannot {block.type}: expected {able}"
                )
        self._last = (order.text_hash, binding, mission)
        return mission
