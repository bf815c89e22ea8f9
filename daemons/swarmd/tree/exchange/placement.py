"""Measures the placement of the applications of this computer on request: load, and values of the others."""

import asyncio
import math
import os
from collections import Counter
from typing import TypeVar

import msgspec

from swarmd.tree.core.tree import SwarmTree
from swarmd.tree.core.values.input_meter import InputMeter
from swarmd.tree.exchange.tree_exchange import TreeExchange
from swarmware.model import names, paths
from swarmware.module.meta import Meta
from swarmware.module.module import Module
from swarmware.runtime.processor import ProcessorUse
from swarmware.types.net import MediumUse, Neighbours
from swarmware.types.placement import PlacedApplication, PlacementRequest, RemoteInput, UnitPlacement
from swarmware.types.system import AppStatus
from swarmware.types.traffic import Traffic

T = TypeVar("T", bound=msgspec.Struct)


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
        # the measured time, as the sleep ends later on a busy computer
        span_s = max((module.now_ns() - start_ns) / 1e9, 1e-3)
        return UnitPlacement(
            own.platform,
            own.unit,
            round(span_s, 3),
            os.cpu_count() or 1,
            round(processor.percent() * (os.cpu_count() or 1), 1),
            self._applications(),
            self._inputs(meter),
            self._rates_bit_s(),
        )

    def _rates_bit_s(self) -> dict[str, float]:
        """Rates of the links to the platform's other computers, by unit: of the medium that its frames take,
        as configured, else as measured while the link was the limit; an unknown rate is left out."""
        own = self._module.node.address
        neighbours = self._newest("net/neighbours", Neighbours)
        traffic = self._newest("net/traffic", Traffic)
        measured = {
            link.platform: link.capacity_bytes_s * 8
            for link in (traffic.links if traffic else ())
            if link.capacity_bytes_s
        }
        found: dict[str, float] = {}
        for one in neighbours.neighbours if neighbours else ():
            if one.platform != own.platform:
                continue
            used = [
                medium.rate_bit_s for medium in one.media if medium.use in {MediumUse.OUT, MediumUse.BOTH}
            ]
            rate_bit_s = (used[0] if used else 0.0) or measured.get(one.platform, 0.0)
            if rate_bit_s:
                found[one.unit] = rate_bit_s
        return found

    def _newest(self, path: str, cls: type[T]) -> T | None:
        board = self._module.reader(path, cls)
        value = board.value
        # through the module, which else would keep the closed reader until its end
        self._module.close_reader(board)
        return value

    def _applications(self) -> tuple[PlacedApplication, ...]:
        table = self._module.node.applications.table
        # the processor time is known of a process only, which several applications may share
        in_process = Counter(entry.pid for entry in table)
        found = []
        for entry in sorted(table, key=lambda entry: entry.id):
            status = self._newest(paths.status(entry.name), AppStatus)
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
        needs: dict[str, float] = {}
        for entry in self._module.node.applications.table:
            for text in entry.reads:
                platform, local = names.split(text)
                # a pattern does not name a single input, whose provider could be found
                if platform in {None, own.platform} and "*" not in text:
                    readers.setdefault(local, set()).add(entry.name)
                    if text in entry.needs:
                        needs[local] = min(entry.needs[text], needs.get(local, math.inf))
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
                    needs.get(path, item.resource.max_age_s),
                    count.values if count else 0,
                    count.payload_bytes if count else 0,
                    count.mean_ms if count else None,
                    count.quantile_ms(0.95) if count else None,
                    count.quantile_ms(1.0) if count else None,
                )
            )
        return tuple(found)
