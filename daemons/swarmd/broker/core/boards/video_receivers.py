"""Platforms to which a channel cannot go as video, because the service `video` does not run there."""

from typing import Final

from swarmware.errors import InvalidInput
from swarmware.model import names
from swarmware.types.channel import ChannelLimit, ChannelRefusal, SetChannel
from swarmware.types.tree import Quality, TreeList, TreeListing

QUESTION: Final = TreeList("/*/sys/video/open")
"""Asks the tree of this node which platforms have the address at which they agree to receive video."""
_REASON: Final = "the service `video` does not run there: no value arrives; expected it in node.toml"


def without_video(request: SetChannel, own: str, listing: TreeListing) -> tuple[ChannelRefusal, ...]:
    """Platforms of the link that are in reach and cannot receive video; those with unknown resources are not
    among them.

    Raises: InvalidInput when none of the link that is in reach can.
    """
    rule = ChannelLimit(request.pattern, request.settings, link=request.link)
    able = {names.split(entry.path)[0] for entry in listing.entries if entry.quality != Quality.LOST}
    reached = {
        one.platform: one.platform in able or not one.digest
        for one in listing.platforms
        if one.reachable and one.platform != own and rule.is_to(one.platform)
    }
    unable = sorted(platform for platform, is_able in reached.items() if not is_able)
    if unable and not any(reached.values()):
        raise InvalidInput(f"link {request.link!r}: {', '.join(unable)}: {_REASON}")
    return tuple(ChannelRefusal(f"/{platform}", _REASON) for platform in unable)
