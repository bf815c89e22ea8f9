"""What may come in from other platforms: the sender's role, the path, and who was turned away."""

from collections.abc import Mapping
from typing import Final

from swarmware.access import Access, Role, Sender, Verb
from swarmware.delivery import answerable, with_sender
from swarmware.frame import Frame
from swarmware.types.net import Denial

REPORT_NS: Final = 1_000_000_000
"""The same refusal is reported this often at most, with its number."""
REFUSALS_MAX: Final = 256


class AccessFilter:
    """Asks for the rights of everything that an application of this platform is to take or answer."""

    def __init__(self, roles: Mapping[str, Role] | None, access: Access) -> None:
        """`roles`: of the members; None, without a roster: all passes, only this computer is served."""
        self._access = access
        self._open = roles is None
        self._roles = roles or {}
        self._reported: dict[tuple[str, str], tuple[int, int]] = {}

    def check(self, frame: Frame, platform: str, path: str | None, arrived_ns: int | None = None) -> None:
        """Whether it may pass; names its sender and its arrival in it.

        `path`: where it goes; None where nobody takes it.
        Raises: Denied, WireError when its extension is none.
        """
        sender = None if self._open else Sender(platform, self._roles.get(platform, Role.OBSERVER))
        asks = answerable(frame)
        frame.extension = with_sender(frame.extension, sender if asks else None, arrived_ns if asks else None)
        if path is not None and asks:
            self._access.check(sender, Verb.CALL, path)

    def denied(self, platform: str, path: str, reason: str, now_ns: int) -> Denial | None:
        """A refusal; what there is to report of it now."""
        key = platform, path
        said_ns, count = self._reported.pop(key, (now_ns - REPORT_NS, 0))
        if len(self._reported) >= REFUSALS_MAX:
            del self._reported[next(iter(self._reported))]
        if now_ns - said_ns < REPORT_NS:
            self._reported[key] = said_ns, count + 1
            return None
        self._reported[key] = now_ns, 0
        role = self._roles.get(platform, Role.OBSERVER)
        return Denial(platform, role.name.lower(), str(Verb.CALL), path, count + 1, reason)
