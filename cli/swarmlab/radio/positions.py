"""True positions of the simulated vehicles, read from the shared memory of their nodes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from swarmctl.session.labs import LabNode
from swarmlab.radio.core.network import Position
from swarmware.errors import WireError
from swarmware.model.names import platform_of
from swarmware.node.follower import RingFollower
from swarmware.transport.shm.layout import ring_file
from swarmware.types import registry
from swarmware.types.vehicle import Pose

TRUTH: Final = "sim/truth"


class VehiclePositions:
    """Follows the true pose of each platform, at the computer of a distributed vehicle that publishes it."""

    def __init__(self, nodes: Sequence[LabNode]) -> None:
        self._nodes = [
            [index for index, other in enumerate(nodes) if platform_of(other.platform) == platform]
            for platform in (platform_of(node.platform) for node in nodes)
        ]
        self._followers = [RingFollower(ring_file(Path(node.shm_dir), TRUTH)) for node in nodes]

    def read(self) -> dict[int, Position]:
        """Positions of the nodes whose platform has moved since the last call."""
        found: dict[int, Position] = {}
        for index, follower in enumerate(self._followers):
            frame = follower.newest()
            if frame is None:
                continue
            try:
                pose = registry.decode(Pose, frame.payload, frame.codec)
            except WireError as error:
                follower.refuse(error)
                continue
            # only one computer of a vehicle publishes its pose, and all of them move with it
            for node in self._nodes[index]:
                found[node] = (pose.x_m, pose.y_m, pose.z_m)
        return found

    def close(self) -> None:
        """Closes the files of all platforms."""
        for follower in self._followers:
            follower.close()
