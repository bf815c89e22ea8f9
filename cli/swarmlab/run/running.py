"""A lab whose processes this process starts and watches."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Coroutine
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from swarmctl.session import labs, processes
from swarmctl.session.labs import LabNode, LabState
from swarmctl.session.processes import NODE_MARK
from swarmlab.provision import database, node_files, provisioning
from swarmlab.radio.namespace import ENTER
from swarmlab.run.child import child_environment, exit_description, tail
from swarmlab.run.fork_server_child import ForkServerChild, fork_variables
from swarmlab.run.notify import NotifySocket, Restarts
from swarmlab.run.shared_child import SharedChild
from swarmware.errors import NoAnswer, SwarmError
from swarmware.runtime.backoff import RestartPolicy
from swarmware.runtime.processes import WatchedProcess

T = TypeVar("T")

Watcher = Callable[[str, str], None]
"""Called on each change with the platform and `started` or `ready`."""

ASKED: Final = frozenset({signal.SIGTERM, signal.SIGINT, signal.SIGHUP})
"""Signals that request the end of a node; after any other signal it is restarted."""

RESTARTS: Final = 5
"""Consecutive restarts of a parent that does not become ready; after them, in nine seconds, the node has
failed."""


def at_once() -> int:
    """Maximum number of nodes that start concurrently: more would delay each other."""
    return max(2, 2 * (os.cpu_count() or 1))


def command(node: LabNode) -> list[str]:
    """Command line of a node."""
    enter = [*ENTER, f"--net={node.namespace}"] if node.namespace else []
    if node.user_namespace:
        enter.append(f"--user={node.user_namespace}")
    return [*enter, sys.executable, "-m", "swarmd", "node", "--config", str(node.config_dir)]


def environment(lab: LabState, node: LabNode) -> dict[str, str]:
    """Environment of a node's processes."""
    variables = child_environment(lab, node.notify_path) | {NODE_MARK: node.folder}
    return variables | fork_variables(lab, node)


def _needed(lab: LabState, on_change: Callable[[], None]) -> list[SharedChild]:
    """Processes without which the nodes do not reach each other, or the database of the lab."""
    modules = {}
    if lab.radio_file:
        modules["radio"] = "swarmlab.radio"
        if lab.mongodb_uri and database.server_of(lab.mongodb_uri) is not None:
            modules["database gateway"] = "swarmlab.run.database_gateway"
    return [
        SharedChild(lab, name, [sys.executable, "-m", module, lab.folder], on_change)
        for name, module in modules.items()
    ]


class RunningLab:
    """Starts the nodes, a few at a time, and watches them by pidfd, without polling."""

    def __init__(self, lab: LabState, *, heals: bool = True) -> None:
        """`heals`: a node whose parent was killed is restarted."""
        self.state = lab
        self._heals = heals
        self.log_of: Callable[[LabNode], Path] = lambda node: node.log_file
        """Path of a node's log after the end of the lab."""
        self.watcher: Watcher = lambda _platform, _what: None
        self.on_restart: Callable[[str, str], None] = lambda _platform, _what: None
        """Called with platform and text when its supervisor restarts its process, and when that is ready."""
        self._needed = _needed(lab, self._note_change)
        self._shared = [*self._needed, ForkServerChild(lab, node_files.services(lab), self._note_change)]
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._processes: dict[str, WatchedProcess] = {}
        self._sockets: dict[str, NotifySocket] = {}
        self._changed = asyncio.Event()
        self._restart_policies: dict[str, RestartPolicy] = {}
        self._again: dict[str, tuple[asyncio.TimerHandle, int]] = {}
        """Nodes with a scheduled restart, with their exit codes."""
        self._watching = True
        self.fallen: dict[str, int] = {}
        """Exit codes of nodes that ended, or the negative number of the signal that ended them."""
        self.restarts: dict[str, Restarts] = {}
        """Restarts of nodes by their supervisors."""
        self.began_mono_ns = 0
        """When the first process was started."""

    def ready(self, platform: str) -> bool:
        """Whether the node has reported that it is ready."""
        return platform in self._sockets and self._sockets[platform].ready

    async def start_shared(self, timeout_s: float) -> None:
        """Starts what the nodes share; returns when they can enter their namespaces and be forked.

        Raises: Denied without the rights, SwarmError when it ends, NoAnswer when it is not ready in time.
        """
        self.began_mono_ns = time.monotonic_ns()
        for child in self._shared:
            await child.start(timeout_s)

    async def start(self, order: list[str], timeout_s: float) -> None:
        """Starts these nodes in this order and returns when all of them are ready.

        Raises: SwarmError when a node ends, NoAnswer when one is not ready in time.
        """
        self.began_mono_ns = self.began_mono_ns or time.monotonic_ns()
        waiting = list(order)
        starting: set[str] = set()
        try:
            async with asyncio.timeout(timeout_s):
                while waiting or starting:
                    self._changed.clear()
                    for platform in sorted(starting):
                        if self.ready(platform):
                            starting.discard(platform)
                            self.watcher(platform, "ready")
                    # after the ready ones are taken off, so that each makes room for the next
                    while waiting and len(starting) < at_once():
                        platform = waiting.pop(0)
                        self._launch(self.state.node(platform))
                        starting.add(platform)
                        self.watcher(platform, "started")
                    self.check()
                    if waiting or starting:
                        await self._changed.wait()
        except TimeoutError:
            late = ", ".join(sorted(starting))
            status = "; ".join(self._sockets[name].status or "silent" for name in sorted(starting))
            raise NoAnswer(
                f"lab {self.state.name}: {late} not ready ({status}); expected within {timeout_s:g} s"
            ) from None

    def check(self) -> None:
        """Raises: SwarmError with the end of its log when a node, or a process that all need, has ended."""
        for child in self._needed:
            child.check()
        for platform, code in self.fallen.items():
            node = self.state.node(platform)
            raise SwarmError(
                f"node {platform}: ended with {exit_description(code)} ({self.log_of(node)});"
                f" expected to run\n"
                f"{tail(node.log_file)}"
            )

    async def attended(self, work: Coroutine[Any, Any, T]) -> T:
        """Returns the result of the work, while all nodes run.

        Raises: SwarmError with the end of its log when a node has ended.
        """
        # a task, so that the work can be given up when a node ends
        task = asyncio.create_task(work, name="work")
        fallen = asyncio.create_task(self.until_fallen(), name="fallen")
        try:
            await asyncio.wait([task, fallen], return_when=asyncio.FIRST_COMPLETED)
            self.check()
            return await task
        finally:
            task.cancel()
            fallen.cancel()
            await asyncio.gather(task, fallen, return_exceptions=True)

    async def until_fallen(self, known: Collection[str] = ()) -> None:
        """Returns when a node has ended that is not in `known`.

        Raises: SwarmError when a process has ended that all nodes need.
        """
        while not self.fallen.keys() - set(known):
            for child in self._needed:
                child.check()
            self._changed.clear()
            await self._changed.wait()

    def _note_change(self) -> None:
        self._changed.set()

    def _launch(self, node: LabNode) -> None:
        loop = asyncio.get_running_loop()
        if node.platform not in self._sockets:
            notify = self._sockets[node.platform] = NotifySocket(node.notify_path)
            loop.add_reader(notify.fileno(), self._on_notify, node.platform, notify)
            self._restart_policies[node.platform] = RestartPolicy(limit=RESTARTS)
        with node.log_file.open("ab") as log:
            child = subprocess.Popen(
                command(node),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment(self.state, node),
                cwd=node.folder,
                start_new_session=True,
            )
        self._children[node.platform] = child
        self._processes[node.platform] = WatchedProcess(child.pid, partial(self._on_exit, node.platform))
        who = processes.identity(child.pid)
        known = msgspec.structs.replace(node, pid=who.pid, pid_start=who.start_ticks)
        nodes = tuple(known if old.platform == node.platform else old for old in self.state.nodes)
        self.state = msgspec.structs.replace(self.state, nodes=nodes)
        labs.save(self.state)

    def save_ready(self) -> float:
        """Saves that the whole swarm is ready; returns the seconds since the first start."""
        ready_s = (time.monotonic_ns() - self.began_mono_ns) / 1e9
        self.state = msgspec.structs.replace(self.state, ready_s=ready_s)
        labs.save(self.state)
        return ready_s

    def _on_notify(self, platform: str, notify: NotifySocket) -> None:
        restarts, ready = notify.restarts, notify.ready
        notify.drain()
        if notify.ready and not ready:
            self._restart_policies[platform].on_ready(time.monotonic_ns())
        restarted = notify.restarts != restarts
        if restarted:
            self.restarts[platform] = notify.restarts
            self.on_restart(platform, str(notify.restarts))
        if notify.restarts.count and notify.ready and (restarted or not ready):
            self.on_restart(platform, "ready again")
        self._changed.set()

    def _on_exit(self, platform: str) -> None:
        self._processes.pop(platform).close()
        code = self._children[platform].wait()
        pause_s = None
        # a node that exits by itself has failed or was asked to; only a killed one is restarted
        killed = code < 0 and -code not in ASKED
        # `lab down` may run in another process, whose SIGKILL must not lead to a restart
        if killed and self._heals and self._watching and not provisioning.is_ending(self.state):
            pause_s = self._restart_policies[platform].on_end(
                time.monotonic_ns(), killed=-code == signal.SIGKILL
            )
        if pause_s is None:
            self.fallen[platform] = code
        else:
            # no other process restarts the parent of a node; the new parent adopts its running child
            timer = asyncio.get_running_loop().call_later(pause_s, self._launch_again, platform)
            self._again[platform] = (timer, code)
            notify = self._sockets[platform]
            notify.drain()  # sent before its end
            notify.supervisor_died(exit_description(code))
            self.restarts[platform] = notify.restarts
            self.on_restart(platform, str(notify.restarts))
        self._changed.set()

    def _launch_again(self, platform: str) -> None:
        _, code = self._again.pop(platform)
        if provisioning.is_ending(self.state):
            self.fallen[platform] = code
            self._changed.set()
        else:
            self._launch(self.state.node(platform))

    def stop_watching(self) -> None:
        """Stops watching after processing earlier exits and notifications; the nodes continue."""
        loop = asyncio.get_running_loop()
        self._watching = False
        for shared in self._shared:
            shared.stop_watching()
        for platform, (timer, code) in self._again.items():
            timer.cancel()
            self.fallen[platform] = code
        self._again.clear()
        # messages that are waiting still count: READY may have been sent just before
        for platform, notify in self._sockets.items():
            self._on_notify(platform, notify)
        for platform in list(self._processes):
            # an exit whose event the loop has not delivered yet
            if self._children[platform].poll() is not None:
                self._on_exit(platform)
        for process in self._processes.values():
            process.close()
        self._processes.clear()
        for notify in self._sockets.values():
            loop.remove_reader(notify.fileno())
            notify.close()
        self._sockets.clear()

    def detach(self) -> None:
        """Lets this process end before the nodes."""
        for shared in self._shared:
            shared.detach()
        for child in self._children.values():
            # without this the interpreter warns that they still run
            child.returncode = child.returncode if child.returncode is not None else 0

    def wait_children(self) -> None:
        """Waits for the exit codes of all ended children."""
        for shared in self._shared:
            shared.wait()
        for child in self._children.values():
            child.wait()
