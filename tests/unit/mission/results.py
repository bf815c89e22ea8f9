"""Results of blocks by their label, for tests."""

from swarmware.mission.outcome import BlockOutcome, OutcomeKind


def result(label: str) -> BlockOutcome:
    """The result `ok`, `timeout`, `cancelled` or `error:<kind>`."""
    end, _, error = label.partition(":")
    return BlockOutcome(OutcomeKind(end), error)
