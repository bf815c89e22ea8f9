"""Records of the runs of missions that a platform has played, and the requests for them."""

import msgspec

from swarmware.types.mission import Member, MissionProgress, ParamValue
from swarmware.types.registry import register


@register
class LogCut(msgspec.Struct, frozen=True):
    """Part of a platform's log that belongs to a run: an index, not a copy."""

    platform: str
    first_ns: int
    """Own hardware clock when the order was accepted."""
    first_utc_ns: int
    last_ns: int = 0
    """Own hardware clock when the run ended, or 0 while it has not."""
    last_utc_ns: int = 0
    segments: tuple[str, ...] = ()
    """Names of the segments in the folder of the log; until the end of the run, the first one alone. The
    ring may have overwritten the oldest ones since."""


@register
class RunRecord(msgspec.Struct, frozen=True):
    """One run of a mission on one platform (`run.json` in the folder of the run)."""

    epoch: int
    """Number of the run, the same at all its members."""
    mission: str
    role: str
    hash: str
    """BLAKE2b-128 of all files of the mission, hex."""
    file: str
    """Name of the role's file, as in the order."""
    text_hash: str
    """BLAKE2b-128 of the role's file, whose text is `document.json` in the folder of the run."""
    params: dict[str, ParamValue]
    priority: int
    members: tuple[Member, ...]
    issuer: str
    """Platform that sent the order."""
    ordered_by: str
    """Authenticated sender of the order (`user@platform`), or "" if it is not known."""
    findings: tuple[str, ...]
    """Findings of the check of the role's file on this platform; an accepted mission has only warnings."""
    log: LogCut
    outcome: str = ""
    """done | failed | aborted | idle (withdrawn before it began), or "" while the run has not ended."""
    reason: str = ""
    steps: int = 0
    """Number of steps in `progress.jsonl`, counted at the end."""
    left_out: int = 0
    """Number of steps that were left out, because `progress.jsonl` had reached its maximum size."""


@register
class RunSummary(msgspec.Struct, frozen=True):
    """One run in the list of the runs of a platform."""

    epoch: int
    """Number of the run, which `mission history --show` and `log query --mission` take."""
    mission: str
    role: str
    outcome: str
    """done | failed | aborted | idle | open, or interrupted if the daemon ended during the run."""
    reason: str
    ordered_by: str
    began_utc_ns: int
    ended_utc_ns: int
    """0 without an end."""
    folder: str


@register
class MissionHistory(msgspec.Struct, frozen=True):
    """The runs of a platform, newest first (`sys/mission/history`)."""

    platform: str
    runs: tuple[RunSummary, ...]
    failed_writes: int = 0
    """Number of writes to folders of runs that failed since the daemon started."""
    failure: str = ""
    """Reason of the newest failed write."""


@register
class RunRequest(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Request for one run (`sys/mission/run`)."""

    epoch: int


@register
class RunDetails(msgspec.Struct, frozen=True):
    """One run of a platform (`sys/mission/run`)."""

    platform: str
    summary: RunSummary
    record: RunRecord
    document: str
    """BDL text of the platform's part, as it ran."""
    progress: tuple[MissionProgress, ...]
    """Steps in their order; of a long run the newest ones."""
