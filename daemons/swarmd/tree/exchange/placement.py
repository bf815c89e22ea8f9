"""Measures the placement of the applications of this computer on request: load, and values of the others."""

import asyncio
import os
from collections import Counter

from swarmd.tree.core.tree import SwarmTree
from swarmd.tree.core.values.input_meter import InputMeter
from swarmd.tree.exchange.tree_exchange import TreeExchange
from swarmware.model import names, paths
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.runtime.processor import ProcessorUse
from swarmware.types.placement import PlacedApplication, PlacementRequest, RemoteInput, UnitPlacement
from swarmware.types.system import AppStatus


class PlacementMeasurement:
    """Serves `sys/tree/placement`; without a request it costs nothing."""

    def __init__(self, module: Module, tree: SwarmTree, exchange: TreeExchange) -> None:
        self._module = module
        self._tree = tree
        self._exchange = exchange

    def serve(self) -> None:
        """Registers the handler of the request."""
        self._module.serve("sys/tree/placement", PlacementRequest, self._measure, reply=UnitPlacement)

    async def _measure(self, request: PlacementRequest, meta: Meta) -> UnitPlacement:
        module = self._module
        own = module.node.address
        meter = InputMeter(own, module.remote_clocks.to_local)
        processor, start_ns = ProcessorUse(), module.now_ns()
        with self._exchange.metered(meter):
            await asyncio.sleep(request.window_s)
        span_s = max((module.now_ns() - start_ns) / 1e9, 1e-3)
        return UnitPlacement(
            own.platform,
            own.unit,
            round(span_s, 3),
            os.cpu_count() or 1,
            round(processor.percent() * (os.cpu_count() or 1), 1),
            self._applications(),
            self._inputs(meter),
        )

    def _applications(self) -> tuple[PlacedApplication, ...]:
        table = self._module.node.applications.table
        in_process = Counter(entry.pid for entry in table)
        found = []
        for entry in sorted(table, key=lambda entry: entry.id):
            board = self._module.reader(paths.status(entry.name), AppStatus)
            status = board.value
            board.close()
            found.append(
                PlacedApplication(
                    entry.name,
                    status.cpu_percent if status else 0.0,
                    in_process[entry.pid],
                    status.loop_lag_ms if status else 0.0,
                    len(entry.provides) + len(entry.serves) + len(entry.reads),
                )
            )
        return tuple(found)

    def _inputs(self, meter: InputMeter) -> tuple[RemoteInput, ...]:
        """Resources of the platform that applications read here, and another computer provides."""
        own = self._module.node.address
        readers: dict[str, set[str]] = {}
        for entry in self._module.node.applications.table:
            for text in entry.reads:
                platform, local = names.split(text)
                if platform in {None, own.platform} and "*" not in text:
                    readers.setdefault(local, set()).add(entry.name)
        found = []
        for path, applications in sorted(readers.items()):
            unit = self._tree.replicas.units.provider(own.platform, path)
            item = None if unit is None or unit.index is None else unit.index.get(path)
            if unit is None or item is None or item.lost:
                continue
            count = meter.counts.get((unit.address.unit, path))
            found.append(
                RemoteInput(
                    path,
                    unit.address.unit,
                    tuple(sorted(applications)),
                    item.resource.rate_hz,
                    item.resource.max_age_s,
                    count.values if count else 0,
                    count.payload_bytes if count else 0,
                    count.mean_ms if count else None,
                    count.worst_ms if count else None,
                )
            )
        return tuple(found)
