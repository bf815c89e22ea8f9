"""The applications of a node: one table for the process, with events for its subscribers."""

import asyncio
from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import NamedTuple, Protocol

from swarmware.model import paths
from swarmware.transport.appfile.entry import AppEntry
from swarmware.transport.appfile.table import AppTable
from swarmware.transport.appfile.trace import died


class Change(Enum):
    """Kind of a change of an application."""

    JOINED = "joined"
    LEFT = "left"
    """The application removed its file, or another process had taken its name at the next refresh."""
    DIED = "died"
    CHANGED = "changed"


class ApplicationEvent(NamedTuple):
    """One change of one application; `entry`: the new content of its file, or the last one if it has
    ended."""

    change: Change
    entry: AppEntry


OnEvents = Callable[[list[ApplicationEvent]], None]


class Watcher(Protocol):
    """Polls shared memory when the doorbell has rung."""

    def poll(self) -> None:
        """Check for new data; called in the event loop, must be cheap."""
        ...


class Waker(Protocol):
    """Calls watchers when shared memory has changed: the node."""

    def listen(self, readers: Path) -> None:
        """Enter this process's doorbell in a table of readers."""
        ...

    def unlisten(self, readers: Path) -> None:
        """Remove the doorbell that `listen` registered."""
        ...

    def watch(self, watcher: Watcher) -> None:
        """Register a watcher, whose `poll` is called whenever the doorbell rings."""
        ...

    def unwatch(self, watcher: Watcher) -> None:
        """Cancel what `watch` registered."""
        ...


class ApplicationSubscription:
    """One subscriber; `close` ends it."""

    def __init__(self, applications: "Applications", on_events: OnEvents) -> None:
        self._applications = applications
        self.on_events = on_events
        self.pending: list[ApplicationEvent] = []

    def close(self) -> None:
        """End the subscription; events that were not delivered yet are dropped."""
        self.pending.clear()
        self._applications.unsubscribe(self)


class Applications:
    """Compares the node's table of applications with the last reported state, and reports the differences."""

    def __init__(self, table: AppTable, waker: Waker, shm_dir: Path, run_dir: Path) -> None:
        self.table = table
        self._waker = waker
        self._readers = paths.applications_watchers(shm_dir)
        self._run_dir = run_dir
        self._loop = asyncio.get_running_loop()
        self._subscriptions: list[ApplicationSubscription] = []
        self._known: dict[str, AppEntry] = {}
        self._comes = False

    def subscribe(self, on_events: OnEvents) -> ApplicationSubscription:
        """Call `on_events` with each change from now on; `table` has the present applications."""
        if not self._subscriptions:
            self.table.complete()
            self._waker.listen(self._readers)
            self._waker.watch(self)
            self.table.on_change = self._on_change
            self._known = {entry.id: entry for entry in self.table}
        self.refresh(probe=True)
        made = ApplicationSubscription(self, on_events)
        self._subscriptions.append(made)
        return made

    def unsubscribe(self, subscription: ApplicationSubscription) -> None:
        """Cancel a subscription made by `subscribe`."""
        if subscription in self._subscriptions:
            self._subscriptions.remove(subscription)
            if not self._subscriptions:
                self.table.on_change = None
                self._waker.unwatch(self)
                self._waker.unlisten(self._readers)

    def poll(self) -> None:
        """The doorbell has rung, perhaps for a change."""
        self.refresh()

    def refresh(self, *, probe: bool = False) -> None:
        """Check for changes and deliver them; `probe`: also check for applications that died."""
        self.table.refresh(probe=probe)
        self._deliver()

    def _on_change(self) -> None:
        """The table has changed, perhaps within another call: deliver in the next iteration of the loop."""
        present = {entry.id: entry for entry in self.table}
        known, self._known = self._known, present
        events = [
            ApplicationEvent(self._end(entry), entry) for app, entry in known.items() if app not in present
        ]
        for app, entry in present.items():
            before = known.get(app)
            if before is None:
                events.append(ApplicationEvent(Change.JOINED, entry))
            # The name was taken over between two refreshes: subscribers must see the end of the former
            # process.
            elif (before.pid, before.pid_start) != (entry.pid, entry.pid_start):
                events.append(ApplicationEvent(Change.LEFT, before))
                events.append(ApplicationEvent(Change.JOINED, entry))
            elif before != entry:
                events.append(ApplicationEvent(Change.CHANGED, entry))
        for subscription in self._subscriptions:
            # collected here, so that a subscriber that is called later misses none
            subscription.pending += events
        if events and not self._comes:
            self._comes = True
            self._loop.call_soon(self._deliver)

    def _end(self, entry: AppEntry) -> Change:
        return Change.DIED if died(self._run_dir, entry) else Change.LEFT

    def _deliver(self) -> None:
        self._comes = False
        # a copy: a subscriber may end its subscription in the call
        for subscription in tuple(self._subscriptions):
            events, subscription.pending = subscription.pending, []
            if events:
                subscription.on_events(events)
