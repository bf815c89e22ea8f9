"""State of the node's applications: alive, hung, died or restarted."""

from collections.abc import Iterator
from typing import Final

import msgspec

from swarmware.model.resource import Resource
from swarmware.types.health import OK_STATE, Level
from swarmware.types.system import AppStatus

DIED: Final = "died"
HUNG: Final = "hung"
FAILED: Final = "failed"
"""State of a service that ended with an error and was restarted inside the same process."""

APP_LEVELS: Final[dict[str, Level]] = {OK_STATE: "ok", DIED: "error", HUNG: "error", FAILED: "warn"}


class WatchedApp(msgspec.Struct):
    """One application instance that is watched."""

    id: str
    name: str
    pid: int
    since_ns: int
    resources: dict[str, Resource] = {}
    state: str = OK_STATE
    beats: bool = False
    """True once the application has written a heartbeat; before, its end or silence is not a fault."""
    started_ns: int = 0
    """Node clock at which the application joined."""
    beat: int = -1
    beat_ns: int = 0
    failures: int = 0

    @property
    def check(self) -> str:
        """Name of the check of this application."""
        return f"app/{self.name}" if self.id.endswith("#1") else f"app/{self.id.replace('#', '_')}"


class WatchedApps:
    """Applications of this node since the monitor started."""

    def __init__(self, hung_s: float) -> None:
        self._hung_ns = round(hung_s * 1e9)
        self._apps: dict[str, WatchedApp] = {}
        self._failures: dict[str, int] = {}

    def __iter__(self) -> Iterator[WatchedApp]:
        return iter(list(self._apps.values()))

    def get(self, app_id: str) -> WatchedApp | None:
        """The application with this id."""
        return self._apps.get(app_id)

    def on_running(
        self, app_id: str, name: str, pid: int, resources: dict[str, Resource], now_ns: int
    ) -> WatchedApp:
        """Takes that the application has a file, and so is alive, even if it died before."""
        app = self._apps.get(app_id)
        if app is None:
            app = self._apps[app_id] = WatchedApp(app_id, name, pid, now_ns)
        # the next process of the same application
        if app.pid != pid or app.state == DIED:
            app.pid = pid
            app.state = OK_STATE
            # a full time until its first heartbeat, whatever the former process did
            app.since_ns = app.beat_ns = now_ns
        app.resources = resources
        return app

    def on_died(self, app_id: str, now_ns: int) -> WatchedApp | None:
        """Takes a death without leaving the node; returns the application, or None if its end is not a
        fault."""
        app = self._apps.get(app_id)
        if app is None or app.state == DIED:
            return None
        # commands of operators have no heartbeat, and end as a matter of course
        if not app.beats:
            del self._apps[app_id]
            return None
        app.state = DIED
        app.since_ns = now_ns
        return app

    def restore(self, check: str, now_ns: int) -> None:
        """Restores an application that the previous monitor found dead; its file identifies it on its
        return."""
        name, _, number = check.removeprefix("app/").rpartition("_")
        # `check` leaves the number out of the name of the first instance
        if not (name and number.isdigit()):
            name, number = check.removeprefix("app/"), "1"
        app_id = f"{name}#{number}"
        if app_id not in self._apps:
            self._apps[app_id] = WatchedApp(app_id, name, 0, now_ns, state=DIED, beats=True)

    def remove(self, app_id: str) -> None:
        """Removes an application, whose end is then not a fault any more."""
        self._apps.pop(app_id, None)

    def on_left(self, app_id: str) -> WatchedApp | None:
        """Takes that an application left the node; returns it, or None if it had died before."""
        app = self._apps.get(app_id)
        if app is None or app.state == DIED:
            return None
        return self._apps.pop(app_id)

    def on_status(self, app: WatchedApp, status: AppStatus, now_ns: int) -> bool:
        """Evaluates the status board; returns True if the state changed, and at the first heartbeat."""
        if status.pid != app.pid:
            return False  # left in shared memory by a process that has ended
        first, app.beats = not app.beats, True
        if first:
            # the count continues after a restart of the service in its process, but a new process begins at 0
            app.failures = min(self._failures.get(app.id, status.failures), status.failures)
        self._failures[app.id] = status.failures
        if status.beat != app.beat:
            app.beat = status.beat
            app.beat_ns = now_ns
        state = HUNG if now_ns - app.beat_ns >= self._hung_ns else OK_STATE
        if status.failures > app.failures:
            app.failures = status.failures
            state = FAILED
        if state != app.state:
            app.state = state
            app.since_ns = now_ns
            return True
        return first

    def extend_heartbeats(self, late_ns: int) -> None:
        """Extends the time of the next heartbeats by a delay of the monitor itself."""
        for app in self._apps.values():
            app.beat_ns += late_ns

    def count(self) -> tuple[int, int]:
        """Numbers of alive and of failed applications."""
        # a service that was restarted in its process is alive again
        failed = sum(app.state in {DIED, HUNG} for app in self._apps.values())
        return len(self._apps) - failed, failed
