"""The file with the rules of channels that operators have set, and with what they can take back."""

import logging
from pathlib import Path
from typing import Final

import msgspec

from swarmd.broker.core.boards.channel_table import ChannelTable, KeptChannels
from swarmware.errors import ConfigError, InvalidInput, OutOfRange
from swarmware.model import document
from swarmware.model.clock import Clock, utc_ns
from swarmware.runtime.filewriter import replace_file, set_aside

FILE: Final = "broker.channels"
"""Name of the file in the data folder of the node."""

log = logging.getLogger("swarm.broker")


class ChannelStore:
    """Keeps a table of rules over a restart of the broker."""

    def __init__(self, table: ChannelTable, folder: Path, clock: Clock) -> None:
        """Reads the rules that were kept; a file that cannot be used is set aside."""
        self._table = table
        self._path = folder / FILE
        self._boot_id = clock.boot_id
        try:
            kept = document.json(document.read(self._path), KeptChannels, str(self._path))
            table.restore(kept, self._boot_id, clock.now_ns())
        except FileNotFoundError:
            return
        except (OSError, ConfigError, InvalidInput, OutOfRange) as error:
            aside = set_aside(self._path, f".broken-{utc_ns()}")
            log.error("%s: cannot be used (%s); kept as %s, no rule is in force", self._path, error, aside)

    def keep(self) -> None:
        """Writes the present rules."""
        try:
            replace_file(self._path, msgspec.json.encode(self._table.kept(self._boot_id)), durable=False)
        except OSError as error:
            log.warning(
                "%s: cannot be written: %s; a restart of the broker loses the rules of channels",
                self._path,
                error.strerror,
            )
