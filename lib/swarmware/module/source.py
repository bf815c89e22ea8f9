"""A ring that this process reads, from before its writer comes until after it has gone."""

import logging
from pathlib import Path

from swarmware.errors import NotFound, SwarmError
from swarmware.module.wakeup import Deadline, Wakeup
from swarmware.node import Node
from swarmware.shm.layout import readers_folder
from swarmware.shm.ring import RingReader
from swarmware.shm.ringfile import absent

log = logging.getLogger("swarm.module")


class Source:
    """Opens the ring when it appears, again when it was replaced, and waits for its bell."""

    def __init__(self, node: Node, ring_path: Path) -> None:
        self._node = node
        self._path = ring_path
        self._name = str(ring_path)
        self.ring: RingReader | None = None
        self.before = 0
        """Frames of former rings at the path: after one that was withdrawn the sequences start again."""
        self._listening = False
        self._reported = -1
        self._complained = ""
        self.wakeup = Wakeup()

    def open(self, *, after: int | None = None) -> RingReader | None:
        """The ring that is at the path now; the old one while there is no other."""
        old = self.ring
        if old is None and absent(self._name):
            return None
        try:
            if old is not None and after is not None:
                self.ring = old.reopen()
            else:
                self.ring = RingReader(self._path, after=after)
                if old is not None:
                    if not self.ring.same_epoch(old):
                        self.before += old.sequence
                    old.close()
        except NotFound:
            return self.ring
        except SwarmError as error:
            if str(error) != self._complained:  # once, not at every look
                self._complained = str(error)
                log.warning("%s", error)
            return self.ring
        return self.ring

    def poll(self) -> None:
        """The doorbell has rung: wake those who wait if it was for us."""
        ring = self.ring
        if ring is None or ring.moved:
            if ring is None and absent(self._name):
                return
            self._reported = -1
            self.wakeup.notify()
        elif ring.sequence != self._reported:
            self._reported = ring.sequence
            self.wakeup.notify()

    def listen(self) -> None:
        """Have the doorbell rung; look at the ring after this, not before."""
        if not self._listening:
            self._listening = True
            self._node.listen(readers_folder(self._path))
            self._node.watch(self)

    async def wait(self, deadline: Deadline) -> bool:
        """Wait until the bell rang for this ring; False when the time is over."""
        remaining_s = deadline.remaining_s()
        if remaining_s == 0.0:
            return False
        return await self.wakeup.wait(remaining_s)

    def close(self) -> None:
        """Unmap, and have the doorbell rung no more."""
        if self._listening:
            self._listening = False
            self._node.unwatch(self)
            self._node.unlisten(readers_folder(self._path))
        if self.ring is not None:
            self.ring.close()
            self.ring = None
