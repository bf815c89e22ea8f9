"""Sender of a request: its name for records and operators, its platform for checks."""

from swarmware.module.meta import Meta
from swarmware.module.module import Module


def requester(module: Module, meta: Meta) -> str:
    """`member@platform`, as authenticated; without keys `application@platform`, as far as they are known."""
    if meta.sender is not None:
        return str(meta.sender)
    if meta.sender_hw == module.node.hardware:
        entry = module.node.applications.table.application(meta.sender_app)
        return f"{'?' if entry is None else entry.id}@{module.platform}"
    conversion = module.remote_clocks.conversion(meta.sender_hw)
    return f"?@{f'{meta.sender_hw:08x}' if conversion is None else conversion.platform}"


def requesting_platform(module: Module, meta: Meta) -> str | None:
    """Platform that sent a request, or None for another platform without authentication."""
    if meta.sender is not None:
        return meta.sender.platform
    return module.platform if meta.sender_hw == module.node.hardware else None
