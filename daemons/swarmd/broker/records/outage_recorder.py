"""Publishes the outages of links, and keeps them over a restart of the broker."""

import asyncio
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from swarmd.broker.config import Config
from swarmd.broker.core.broker import BrokerCore
from swarmd.broker.core.reports.outages import Action, OutageLog, ReadBacklog, SaveOutages
from swarmd.broker.core.swarm.links.link import LinkChanged
from swarmware.errors import ConfigError
from swarmware.model import document
from swarmware.model.clock import Clock, utc_ns
from swarmware.model.names import MAIN
from swarmware.module.writer import BoardWriter
from swarmware.runtime.driver import CoreDriver
from swarmware.runtime.filewriter import replace_file
from swarmware.types.outage import OutageTable

FILE: Final = "broker.outages"

log = logging.getLogger("swarm.broker")


class OutageRecorder:
    """The log of outages with its board and its file in the node's data folder."""

    def __init__(
        self,
        config: Config,
        folder: Path,
        board: BoardWriter[OutageTable],
        clock: Clock,
        core: BrokerCore,
        waiting: Callable[[int], tuple[int, int]],
    ) -> None:
        """`waiting`: frames and bytes that wait for the link to a neighbour."""
        self._path = folder / FILE
        self._board = board
        self._clock = clock
        self._nodes = core.nodes
        self._exchange = core.exchange
        self._waiting = waiting
        self._log = OutageLog(config, self._read().outages)
        self._driver = CoreDriver(
            self._log, self._perform, name="outages", clock=clock, loop=asyncio.get_running_loop()
        )
        board.write(self.table())

    def on_link(self, change: LinkChanged) -> None:
        """A link has changed its state."""
        if self._exchange is not None and self._exchange.excludes(change.hw):
            self._driver.feed(self._log.on_forgotten(change.hw, self._clock.now_ns()))
            return
        member = self._nodes.get(change.hw)
        unit = MAIN if member is None else member.unit
        platform = self._nodes.platform(change.hw)
        self._driver.feed(self._log.on_link(change, platform, unit, self._clock.now_ns()))

    def table(self) -> OutageTable:
        """All outages, the newest first."""
        return self._log.table(self._clock.now_ns(), utc_ns())

    @property
    def lost(self) -> int:
        """Links that were up and are not."""
        return self._log.lost

    def _perform(self, action: Action) -> None:
        match action:
            case ReadBacklog():
                frames, size = self._waiting(action.hw)
                self._driver.feed(self._log.on_backlog(action.hw, frames, size, self._clock.now_ns()))
            case SaveOutages():
                table = self.table()
                self._board.write(table)
                self._save(table)

    def _read(self) -> OutageTable:
        try:
            return document.json(document.read(self._path), OutageTable, str(self._path))
        except FileNotFoundError:
            return OutageTable()
        except ConfigError as error:
            log.warning("%s; outages before this start are not shown", error)
            return OutageTable()

    def _save(self, table: OutageTable) -> None:
        try:
            replace_file(self._path, msgspec.json.encode(table), durable=False)
        except OSError as error:
            log.warning(
                "%s: cannot be written: %s; a restart of the broker loses the outages",
                self._path,
                error.strerror,
            )

    def close(self) -> None:
        """Stop reading the queues of links; save what was not saved yet."""
        self._driver.stop()
        if self._log.unsaved:
            self._save(self.table())
