"""State on disk that survives a restart of the broker: session number, and longest declared period."""

import logging
from pathlib import Path
from typing import Final

from swarmd.broker.core.beacon.beacon_rate import IDLE_HZ
from swarmd.broker.core.beacon.declared_period import CEILINGS_NS
from swarmd.broker.core.swarm.neighbour import notice_ns
from swarmware.errors import Denied
from swarmware.runtime.filewriter import replace_file
from swarmware.transport.security.seal import SESSION_MARK

SESSION: Final = "broker.session"
PERIOD: Final = "broker.period"
_IDLE_NS: Final = round(1e9 / IDLE_HZ)

log = logging.getLogger("swarm.broker")


class SessionStore:
    """Stores the session of this node's broker, for the next start."""

    def __init__(self, folder: Path) -> None:
        self._session = folder / SESSION
        self._period = folder / PERIOD
        self.declared_period_ns = self._read() if self._session.exists() else 0
        """Longest time between two datagrams that the former session declared, or 0 if unknown."""

    def quiet_ns(self, timeout_ns: int) -> int:
        """Time for which neighbours may still use routes of the former session.

        An empty folder does not prove that there was no former session (the disk may have been replaced), so
        an idle one is assumed: without this wait routes formed loops. A loop stays possible where the lost
        session declared a longer period.
        """
        return notice_ns(self.declared_period_ns or _IDLE_NS, timeout_ns)

    def _read(self) -> int:
        try:
            text = self._period.read_text("ascii")
        except FileNotFoundError:
            return _IDLE_NS  # the session never sent anything, or was of an older version
        except (OSError, UnicodeDecodeError):
            return CEILINGS_NS[-1]
        kept_ns = int(text) * 1_000_000 if text.strip().isdigit() and len(text) < 10 else 0
        if kept_ns in CEILINGS_NS:
            return kept_ns
        log.warning(
            "%s: %r is not a period in ms: the longest is assumed; routes beyond the neighbours come late",
            self._period,
            text[:20],
        )
        return CEILINGS_NS[-1]

    def next_session(self, wanted: int, mark: int = 0) -> int:
        """The session number of this start, greater than all earlier ones, also when the wall clock was set
        back: neighbours refuse old sessions, and a repeated one would repeat nonces. `wanted`: a wall-clock
        stamp; `mark`: of the swarm, the lowest bits of the session.

        Raises: Denied when it cannot be stored.
        """
        try:
            before = int.from_bytes(self._session.read_bytes()[:8], "little") if self._session.exists() else 0
            session = max(wanted, before + 1) & ~SESSION_MARK | mark
            if session <= before:
                session += SESSION_MARK + 1
            self._session.parent.mkdir(parents=True, exist_ok=True)
            replace_file(self._session, session.to_bytes(8, "little"), mode=0o600)
        except OSError as error:
            raise Denied(f"{self._session}: cannot be written: {error.strerror}") from error
        return session

    def keep(self, declared_period_ns: int) -> None:
        """Stores the longest period that this session declared, for the next start."""
        try:
            replace_file(self._period, b"%d\n" % (declared_period_ns // 1_000_000))
        except OSError as error:
            log.warning(
                "%s: cannot be written: %s; a restart within the next minutes may disturb routes for seconds",
                self._period,
                error.strerror,
            )
