"""Access control for frames of other platforms, by the role of the sender and the path."""

from collections.abc import Mapping
from typing import Final

from swarmware.model.access import Access, Role, Sender, Verb
from swarmware.model.frame import Frame
from swarmware.transport.delivery.answer import answerable
from swarmware.transport.delivery.sender import caller_of, with_sender
from swarmware.types.net import Denial

UNKNOWN: Final = "unknown"
"""In place of a role: no member of the swarm."""


class AccessFilter:
    """Checks the rights of frames for applications of this platform."""

    def __init__(self, own: str, roles: Mapping[str, Role] | None, access: Access) -> None:
        """`own`: this platform; `roles`: role of each member, or None without a roster.

        Without a roster every frame passes, as only this computer is served.
        """
        self._access = access
        self._own = own
        self._open = roles is None
        self._roles = roles or {}
        self._senders: dict[str, Sender] = {}

    def set_roles(self, roles: Mapping[str, Role]) -> None:
        """Takes the roles of another roster."""
        self._roles = roles
        self._senders.clear()

    def check(
        self,
        frame: Frame,
        platform: str,
        path: str | None,
        arrived_ns: int | None = None,
        via: tuple[str, ...] = (),
    ) -> None:
        """Checks a frame, and adds its authenticated sender and time of arrival.

        `path`: resource to which the frame is addressed, or None if no application serves it; `via`:
        platforms that forwarded it. A user of the sender's computer has the lower role of its own and its
        platform's.
        Raises: Denied; WireError for an invalid extension.
        """
        sender = self._sender(platform)
        asks = answerable(frame)
        if sender is not None and asks:
            caller = caller_of(frame.extension)
            if caller is not None:
                sender = Sender(platform, min(sender.role, caller.role), caller.name, via)
            elif via:
                sender = Sender(platform, sender.role, via=via)
        frame.extension = with_sender(frame.extension, sender if asks else None, arrived_ns if asks else None)
        if path is not None and asks:
            self._access.check(sender, Verb.CALL, path)

    def _sender(self, platform: str) -> Sender | None:
        if self._open:
            return None
        sender = self._senders.get(platform)
        if sender is None and platform == self._own:
            # another computer of this platform: the applications there have the rights of those here
            sender = self._senders[platform] = Sender(platform, Role.MAINTAINER)
        if sender is None:
            sender = Sender(platform, self._roles.get(platform, Role.OBSERVER))
            if platform in self._roles:
                self._senders[platform] = sender
        return sender

    def denied(
        self,
        platform: str,
        verb: str,
        path: str,
        reason: str,
        caller: str = "",
        via: tuple[str, ...] = (),
    ) -> Denial:
        """A refusal of a platform, with its role."""
        role = self._roles.get(platform)
        name = UNKNOWN if role is None else role.name.lower()
        return Denial(platform, name, str(verb), path, 1, reason, caller, via)
