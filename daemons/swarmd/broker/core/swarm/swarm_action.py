"""Actions of the swarm's tables, which the shell carries out."""

import msgspec

from swarmware.types.time import TimingBatch


class WriteClockSamples(msgspec.Struct, frozen=True):
    """Action: write the clock samples since the last own beacon."""

    batch: TimingBatch


class MediumChanged(msgspec.Struct, frozen=True):
    """Action: frames to a neighbour take another medium from now on."""

    hw: int


class ReportDuplicate(msgspec.Struct, frozen=True):
    """Action: report that two computers use one platform name."""

    platform: str
    own: bool
    """It is the own name."""
    first: bool
    """It was not reported before."""


class ReportDuplicateGone(msgspec.Struct, frozen=True):
    """Action: report that each platform name is used by one computer again."""
