"""Clock samples of received beacons, in batches for the time service."""

from typing import Final

import msgspec

from swarmd.broker.core.swarm.node_table import NodeTable
from swarmware.types.time import TimingBatch, TimingSample


class ClockSample(msgspec.Struct, frozen=True, gc=False):
    """Clock differences of one datagram (share/doc/protocol.md, section 3.4): theirs minus ours."""

    hw: int
    boot_id: int
    rx_ns: int
    """Own clock at reception."""
    reverse_ns: int
    """Clock of the sender at send minus the own clock at reception: the offset minus the delay to here."""
    forward_ns: int | None = None
    """Clock of the neighbour at reception minus the own clock at send: the offset plus the delay to there."""
    forward_tx_ns: int = 0
    """Own clock at send of the echoed datagram."""


class WriteClockSamples(msgspec.Struct, frozen=True):
    """Action: write the clock samples since the last own beacon."""

    batch: TimingBatch


SAMPLES_NS: Final = 490_000_000
"""Time between two batches of clock samples while no link is new: clocks are estimated from them every three
seconds. A little less than half a second, so that the batch is due at every fifth check at 10 Hz."""
SAMPLES_MAX: Final = 48
"""Samples after which a batch is written at once: more would not fit a slot of their stream."""


class ClockBatches:
    """Samples since the last batch, and when the next one is due."""

    def __init__(self, nodes: NodeTable, now_ns: int) -> None:
        self._nodes = nodes
        self._samples: list[ClockSample] = []
        self._due_ns = now_ns

    def on_sample(self, sample: ClockSample) -> None:
        """Takes a sample of a received beacon."""
        self._samples.append(sample)

    def due(self, is_changing: bool, now_ns: int) -> TimingBatch | None:
        """The batch that is due; `is_changing`: links are new, so no sample waits."""
        if not self._samples:
            return None
        if now_ns < self._due_ns and len(self._samples) < SAMPLES_MAX and not is_changing:
            return None
        self._due_ns = now_ns + SAMPLES_NS
        find = self._nodes.get
        samples = tuple(
            TimingSample(
                member.platform,
                member.unit,
                sample.hw,
                sample.boot_id,
                sample.rx_ns,
                sample.reverse_ns,
                sample.forward_tx_ns,
                sample.forward_ns,
            )
            for sample in self._samples
            if (member := find(sample.hw)) is not None
        )
        self._samples.clear()
        return TimingBatch(samples) if samples else None
