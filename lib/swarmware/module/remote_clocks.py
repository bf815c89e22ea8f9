"""Stamps of other hardware units on the own clock, by the conversion functions on board `time/functions`."""

from typing import TYPE_CHECKING

from swarmware.model.names import data_id
from swarmware.types.time import Conversion, TimeFunctions

if TYPE_CHECKING:
    from swarmware.module.board import BoardReader
    from swarmware.node.node import Node

PATH = "time/functions"


class RemoteClocks:
    """Converts stamps of other units; every clock is unknown until timesync has published."""

    def __init__(self, node: "Node") -> None:
        self._node = node
        self._reader: BoardReader[TimeFunctions] | None = None
        self._source: TimeFunctions | None = None
        self._by_hardware: dict[int, Conversion] = {}

    def conversion(self, hardware: int) -> Conversion | None:
        """The function of one unit's clock; None when it is not known."""
        if self._reader is None:
            from swarmware.module.board import BoardReader  # it is a board itself, and boards need this

            self._reader = BoardReader(
                self._node, PATH, TimeFunctions, data_id(PATH, TimeFunctions.__name__), self
            )
        functions = self._reader.value
        if functions is not self._source and functions is not None:
            self._source = functions
            self._by_hardware = {function.hardware: function for function in functions.functions}
        return self._by_hardware.get(hardware)

    def to_local(self, hardware: int, stamp_ns: int) -> int | None:
        """The own clock at a stamp of that unit; None when its clock is not known."""
        if hardware == self._node.hardware:
            return stamp_ns
        conversion = self.conversion(hardware)
        return None if conversion is None else conversion.to_local(stamp_ns)

    def close(self) -> None:
        """Stop reading the board."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None
