"""Requests for resources that another computer of this platform provides: they are forwarded to its tree."""

from typing import Final, TypeVar

import msgspec

from swarmd.tree.operator.tree_view import TreeView
from swarmware.errors import NotFound
from swarmware.model import names, paths
from swarmware.model.access import Sender
from swarmware.model.names import Address
from swarmware.module.meta import Meta
from swarmware.module.module import Module

R = TypeVar("R", bound=msgspec.Struct)

_NAME_LIMIT: Final = 31
"""Bytes of the name of a requester in the header of a frame."""


class UnitForwarder:
    """Finds the computer of this platform that provides a path, and asks its tree for the requester."""

    def __init__(self, module: Module, view: TreeView, answer_s: float) -> None:
        self._module = module
        self.view = view
        self.answer_s = answer_s

    def split(self, path: str) -> tuple[str, str]:
        """Platform or computer, and local path. Raises: InvalidInput; NotFound without a local path."""
        name, local = names.split(names.check_path(path))
        if not local:
            raise NotFound(f"{path}: a platform; expected a resource of it, such as {path}/nav/pose")
        return name or self._module.platform, local

    def is_own(self, name: str) -> bool:
        """Whether this computer answers for the name: its platform, or itself."""
        return name in {self._module.platform, self._module.node.address.path}

    def provider(self, path: str) -> Address | None:
        """Another computer of this platform that provides a path, or None if no other one does."""
        name, local = self.split(path)
        # a path with the name of a computer is meant for exactly this computer
        if name != self._module.platform:
            return None
        unit, _ = self.view.find(name, local) or (None, None)
        return None if unit is None else unit.address

    async def forward(
        self, unit: Address, verb: str, request: msgspec.Struct, reply: type[R], meta: Meta, path: str = ""
    ) -> R:
        """Ask the tree of a computer; a `path` of the request becomes the path at exactly this computer.

        Raises: as the other tree; NoAnswer.
        """
        if path:
            request = msgspec.structs.replace(request, path=names.join(unit.path, names.split(path)[1]))
        return await self._module.request(
            names.join(unit.path, paths.tree_request(verb)),
            request,
            reply,
            timeout_s=self.answer_s,
            # the other tree decides by the rights of the requester, not of this service
            on_behalf_of=self._requester(meta.sender),
        )

    def _requester(self, sender: Sender | None) -> Sender | None:
        """The requester, as stated to other computers of this platform, or None for the platform itself."""
        platform = self._module.platform
        if sender is None or (sender.platform == platform and not sender.caller):
            return None
        name = sender.caller if sender.platform == platform else str(sender)
        # the role stays: forwarding must not raise the rights of the requester
        return Sender(platform, sender.role, name[:_NAME_LIMIT])
