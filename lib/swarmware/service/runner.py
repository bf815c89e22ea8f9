"""Main function of a process of services: configuration, node, signals, watchdog, exit code."""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import resource
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import uvloop

from swarmware.errors import SwarmError, reason
from swarmware.model import config
from swarmware.model.visible import visible_lines
from swarmware.node.node import Node
from swarmware.runtime.core import next_multiple_ns
from swarmware.runtime.instant import until
from swarmware.runtime.slow import warn_if_slow
from swarmware.service.guard_watchdog import GuardWatchdog
from swarmware.service.host import PreparedService, ServiceHost
from swarmware.service.notify import Notifier

DRAIN_S: Final = 4.0
"""Time from SIGTERM to the end, in seconds; the systemd units allow five."""

FILES: Final = 64
FILES_OF_SERVICE: Final = 24
"""Descriptors of a process and of each of its services; 308 measured with eleven, 36 to 66 with one."""

SETTLED_S: Final = 5.0
"""After the start of services: readers, connections and tables of other nodes exist."""

log = logging.getLogger("swarm.runner")


def run_services(config_dir: Path, names: list[str]) -> int:
    """Run services of the node in this process until SIGTERM or SIGINT; the exit code.

    Raises: SwarmError when the configuration is invalid or the node cannot be joined.
    """
    node_config = config.load_node(config_dir)
    with frozen():
        prepared = [PreparedService.of(name, config_dir) for name in names]
    _log_to_stderr(node_config.log_level, node_config.platform)
    _open_many_files(len(names))
    try:
        with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
            return runner.run(_run(config_dir, prepared))
    except OSError as error:
        if (text := reason(error)) is None:
            raise
        raise SwarmError(text) from error


def _open_many_files(services: int) -> None:
    """Raise the soft limit of open files: a mapped ring uses up to three descriptors, and the default is
    1024.

    Raises: SwarmError when the hard limit is too low.
    """
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    needed = FILES + FILES_OF_SERVICE * services
    if hard != resource.RLIM_INFINITY and hard < needed:
        raise SwarmError(
            f"open files: the limit is {hard}, {services} services in this process need {needed};"
            " expected a higher one (ulimit -n, LimitNOFILE=)"
        )


def _on_loop_error(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Log an error in a callback; an expected one in one line."""
    error = context.get("exception")
    if isinstance(error, BaseException) and (text := reason(error)) is not None:
        log.error("%s", text)
    else:
        loop.default_exception_handler(context)


async def _run(config_dir: Path, prepared: list[PreparedService]) -> int:
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(_on_loop_error)
    warn_if_slow(loop)
    asked = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, asked.set)
    notifier = Notifier()
    try:
        node = Node.attach(config_dir)
        try:
            host = ServiceHost(node, prepared)
            node.host = host
            return await _serve(host, notifier, asked)
        finally:
            node.close()
    finally:
        notifier.close()


async def _serve(host: ServiceHost, notifier: Notifier, asked: asyncio.Event) -> int:
    running = asyncio.create_task(host.run(), name="services")
    ending = asyncio.create_task(asked.wait(), name="signals")
    notifying = asyncio.create_task(_notify_ready(host, notifier), name="supervisor")
    others = [notifying, ending]
    if host.node.config.processes == "per-daemon" and "guard" not in host.names:
        others.append(asyncio.create_task(GuardWatchdog(host.node).run(), name="guard watch"))
    try:
        await asyncio.wait([running, ending], return_when=asyncio.FIRST_COMPLETED)
        if running.done():
            return _log_failure(running)
        notifier.stopping()
        log.info("stopping: %s", ", ".join(host.names))
        drain_s = max(DRAIN_S, host.stop_s)  # the guard waits for the services it has started
        try:
            await asyncio.wait_for(host.stop(), drain_s)
        except TimeoutError:
            log.warning("services did not finish within %s s", drain_s)
        return 0
    finally:
        for task in (*others, running):
            task.cancel()
        await asyncio.wait([*others, running], timeout=DRAIN_S)


async def _notify_ready(host: ServiceHost, notifier: Notifier) -> None:
    await host.started()
    failed = host.failed
    running = ", ".join(name for name in host.names if name not in failed)
    notifier.ready(f"{host.node.platform}: {running}" + (f"; failed: {', '.join(failed)}" if failed else ""))
    log.info("ready: %s", running or "no service")
    if failed:
        log.error("not ready: %s", ", ".join(failed))
    freeze_later(asyncio.get_running_loop())
    while notifier.watchdog_s is not None:
        host.on_supervised(notifier.alive())
        clock = host.node.clock
        await until(clock, next_multiple_ns(clock.now_ns(), round(notifier.watchdog_s * 1e9)))


def _log_failure(running: asyncio.Task[None]) -> int:
    error = running.exception() if not running.cancelled() else None
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    text = None if error is None else reason(error)
    if text is None:
        log.error("failed", exc_info=error)
    else:
        log.error("%s", text)
    return error.exit_code if isinstance(error, SwarmError) else 1


class _Lines(logging.Formatter):
    """One line per record; with the priority of sd-daemon(3) if journald reads it."""

    _PRIORITY: Final = {"DEBUG": 7, "INFO": 6, "WARNING": 4, "ERROR": 3, "CRITICAL": 2}

    def __init__(self, platform: str, journal: bool) -> None:
        super().__init__(
            "%(name)s: %(message)s"
            if journal
            else f"%(asctime)s {platform} %(levelname)-7s %(name)s: %(message)s"
        )
        self._journal = journal

    def format(self, record: logging.LogRecord) -> str:
        text = visible_lines(super().format(record))  # of values and names from outside
        mark = f"<{self._PRIORITY.get(record.levelname, 6)}>" if self._journal else ""
        return mark + text.replace("\n", f"\n{mark}  ")  # a traceback stays with its record


def _log_to_stderr(level: str, platform: str) -> None:
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Lines(platform, journal="JOURNAL_STREAM" in os.environ))
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level)


@contextmanager
def frozen() -> Iterator[None]:
    """Freeze objects that are created in the block, such as imported modules (`gc.freeze`).

    A full collection over the 55 000 objects of a node took 30 to 44 ms at unpredictable instants.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def freeze_later(loop: asyncio.AbstractEventLoop) -> asyncio.TimerHandle:
    """Freeze all objects that exist after SETTLED_S."""
    return loop.call_later(SETTLED_S, _spare)


def _spare() -> None:
    gc.collect()
    gc.freeze()
