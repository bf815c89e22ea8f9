"""A neighbour as the broker reports it."""

from swarmware.model.names import hardware_id
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.net import ConnectionStatus, LinkStatus, NeighbourState


def neighbour(platform: str, state: str, version: int = 5, unit: str = "main") -> NeighbourState:
    return NeighbourState(
        platform, unit, hardware_id(platform, unit), PlatformKind.UAV, LinkStatus(state),
        "127.0.0.1:1", 0, 0.0, 10.0,
        0.0, 0.0, None, 256, version, 0, 1, ConnectionStatus.CONNECTED, True,
    )  # fmt: skip
