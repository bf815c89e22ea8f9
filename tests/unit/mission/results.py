"""Results of blocks by their label, for tests."""

from swarmd.mission.core.run import BlockEnd, BlockResult


def result(label: str) -> BlockResult:
    """The result `ok`, `timeout`, `cancelled` or `error:<kind>`."""
    end, _, error = label.partition(":")
    return BlockResult(BlockEnd(end), error)
