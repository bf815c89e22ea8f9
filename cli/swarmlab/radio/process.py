"""The process of the radio: moves frames between the devices of the nodes as its core decides."""

import asyncio
import logging
import random
import selectors
import signal
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from swarmctl.session import labs
from swarmctl.session.labs import LabNode, LabState
from swarmlab.radio import files, orders
from swarmlab.radio.core.network import LinkReport, RadioCore, RadioDelivery, RadioNode
from swarmlab.radio.devices import NamespaceDevices
from swarmlab.radio.orders import CutLinks, HealLinks, ImpairLinks, RadioOrder
from swarmlab.radio.positions import VehiclePositions
from swarmware.model.names import platform_of
from swarmware.model.platform_kind import PlatformKind
from swarmware.service.notify import Notifier

POSITIONS_NS: Final = 200_000_000
"""Positions are read with the first frame after this time: a vehicle moves less than 3 m."""
_VENDOR: Final = b"\x02SW\x00"
"""Start of locally administered Ethernet addresses."""

log = logging.getLogger("swarm.radio")


def ethernet_address(index: int) -> bytes:
    """Ethernet address of the node with this index."""
    return _VENDOR + (index + 1).to_bytes(2, "big")


def radio_node(index: int, node: LabNode) -> RadioNode:
    """The node of a lab in the radio network."""
    flies = node.kind == PlatformKind.UAV
    return RadioNode(node.platform, platform_of(node.platform), flies, ethernet_address(index))


class RadioProcess:
    """Devices, timer and orders of the radio of one lab.

    The driver of the daemons' cores rounds to milliseconds, which is longer than a frame takes here: this one
    has a timer of its own.
    """

    def __init__(self, lab: LabState) -> None:
        """Raises: ConfigError for an invalid radio file, Denied without the rights."""
        self._folder = Path(lab.folder)
        self._nodes = lab.nodes
        self._index = {node.platform: index for index, node in enumerate(lab.nodes)}
        model, trace = files.load_radio(Path(lab.radio_file))
        nodes = [radio_node(index, node) for index, node in enumerate(lab.nodes)]
        self._core = RadioCore(
            model,
            trace,
            nodes,
            # its own stream of the seed: other draws of the lab do not change the losses
            random.Random(f"radio {lab.seed}").random,
            time.monotonic_ns(),
        )
        self._positions = VehiclePositions(lab.nodes)
        self._positions_ns = 0
        self._timer: asyncio.TimerHandle | None = None
        self._timer_ns = 0
        self._devices = NamespaceDevices(lab.nodes, [node.address for node in nodes])

    async def run(self) -> None:
        """Forwards frames until SIGTERM or SIGINT."""
        loop, ended = asyncio.get_running_loop(), asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, ended.set)
        self._devices.start(self._on_frames)
        async with orders.OrderServer(self._folder, self._execute):
            Notifier().ready(f"radio of {len(self._nodes)} nodes")
            await ended.wait()

    def close(self) -> None:
        """Removes the devices of all nodes."""
        self._positions.close()
        self._devices.close()

    def _on_frames(self, index: int, frames: Iterable[bytes]) -> None:
        for data in frames:
            now_ns = time.monotonic_ns()
            # with frames only: without them positions change nothing
            if now_ns >= self._positions_ns:
                self._positions_ns = now_ns + POSITIONS_NS
                self._perform(self._core.on_positions(self._positions.read(), now_ns))
            self._perform(self._core.on_frame(index, data, now_ns))
        self._arm()

    def _on_timer(self) -> None:
        self._timer = None
        self._perform(self._core.on_timer(time.monotonic_ns()))
        self._arm()

    def _perform(self, deliveries: list[RadioDelivery]) -> None:
        for delivery in deliveries:
            if not self._devices.write(delivery.receiver, delivery.data):
                log.debug("node %s: takes no frame", self._nodes[delivery.receiver].platform)

    def _arm(self) -> None:
        due_ns = self._core.deadline_ns()
        # an earlier timer stays: it fires, finds nothing due and arms itself again
        if due_ns is None or (self._timer is not None and self._timer_ns <= due_ns):
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timer_ns = due_ns
        # the loop's clock is CLOCK_MONOTONIC
        self._timer = asyncio.get_running_loop().call_at(due_ns / 1e9, self._on_timer)

    def _execute(self, order: RadioOrder) -> list[LinkReport]:
        """Raises: KeyError for the name of a node that does not exist."""
        links = [(self._index[sender], self._index[receiver]) for sender, receiver in order.links]
        now_ns = time.monotonic_ns()
        if isinstance(order, ImpairLinks):
            self._perform(self._core.on_impairment(links, order.change, now_ns))
        elif isinstance(order, CutLinks):
            self._perform(self._core.on_cut(links, now_ns))
        elif isinstance(order, HealLinks):
            self._perform(self._core.on_heal(links, now_ns))
        self._arm()
        return [self._core.report(sender, receiver, now_ns) for sender, receiver in links]


def _loop() -> asyncio.AbstractEventLoop:
    """Event loop whose time-outs have microseconds, by select(2)."""
    # epoll(7) rounds time-outs up to a millisecond, in which several frames are sent
    return asyncio.SelectorEventLoop(selectors.SelectSelector())


def run_radio(folder: Path) -> None:
    """Runs the radio of the lab in this folder until it is ended.

    Raises: ConfigError for an invalid radio file, Denied without the rights.
    """
    radio = RadioProcess(labs.load(folder))
    try:
        with asyncio.Runner(loop_factory=_loop) as runner:
            runner.run(radio.run())
    finally:
        radio.close()
