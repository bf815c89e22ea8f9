"""A swarm of keys whose roster changes."""

from pathlib import Path

from swarmware.transport.security.keys import Keys
from swarmware.transport.security.root import Root, candidate, make_swarm

NAMES = ("gcs", "uav1", "uav2")


class Swarm:
    """A root and the keys of its members, in memory as brokers hold them."""

    def __init__(self, directory: Path, names: tuple[str, ...] = NAMES) -> None:
        self.directory = directory
        make_swarm(directory, names)
        self.root = Root.load(directory)
        self.keys = {name: Keys.load(directory / name, name) for name in names}

    def admit(self, platform: str, seed: bytes, role: str = "node") -> bytes:
        return self.root.admit(candidate(platform, role, seed, self.root.public))

    def reload(self, platform: str) -> Keys:
        return Keys.load(self.directory / platform, platform)
