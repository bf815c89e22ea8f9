"""Stamps of other hardware units on the own clock, by the conversion functions on board `time/functions`."""

from typing import TYPE_CHECKING

from swarmware.errors import WireError
from swarmware.model.names import data_id
from swarmware.node.node import Node
from swarmware.transport.shm.layout import ring_file
from swarmware.types import registry
from swarmware.types.time import Conversion, TimeFunctions

if TYPE_CHECKING:
    from swarmware.node.follower import RingFollower

PATH = "time/functions"


class RemoteClocks:
    """Converts stamps of other units; every clock is unknown until timesync has published."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._follower: RingFollower | None = None  # opened by the first conversion: many modules need none
        self._by_hardware: dict[int, Conversion] = {}

    def conversion(self, hardware: int) -> Conversion | None:
        """The conversion function of one unit's clock, or None if it is not known."""
        if self._follower is None:
            from swarmware.node.follower import RingFollower

            self._follower = RingFollower(
                ring_file(self._node.shm_dir, PATH),
                name=f"board {PATH}",
                data_id=data_id(PATH, TimeFunctions.__name__),
            )
        frame = self._follower.newest()
        if frame is not None:
            try:
                functions = registry.decode(TimeFunctions, frame.payload, frame.codec).functions
            except WireError as error:
                self._follower.refuse(error)
            else:
                self._by_hardware = {function.hardware: function for function in functions}
        return self._by_hardware.get(hardware)

    def to_local(self, hardware: int, stamp_ns: int) -> int | None:
        """The own clock at a stamp of that unit, or None if its clock is not known."""
        if hardware == self._node.hardware:
            return stamp_ns
        conversion = self.conversion(hardware)
        return None if conversion is None else conversion.to_local(stamp_ns)

    def close(self) -> None:
        """Stop reading the board."""
        if self._follower is not None:
            self._follower.close()
            self._follower = None
