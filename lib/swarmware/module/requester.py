"""Name of the sender of a request, for records and for operators."""

from swarmware.module.meta import Meta
from swarmware.module.module import Module


def requester(module: Module, meta: Meta) -> str:
    """The authenticated member; without keys the platform of the sender, as far as it is known."""
    if meta.sender is not None:
        return str(meta.sender)
    if meta.sender_hw == module.node.hardware:
        return module.platform
    conversion = module.remote_clocks.conversion(meta.sender_hw)
    return f"{meta.sender_hw:08x}" if conversion is None else conversion.platform
