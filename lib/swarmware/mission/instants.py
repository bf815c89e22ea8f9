"""Checks chains of blocks that take no time: the player executes them in one step, which must be bounded."""

from collections.abc import Mapping
from typing import Final

from swarmware.mission.catalogue import BlockName, Wait
from swarmware.mission.finding import Remark
from swarmware.mission.model import STEPS_LIMIT, Block, MissionDefinition

REST_S: Final = 0.01
"""A shorter pause does not count: a loop of such pauses would keep the processor busy and fill the log."""
SHOWN_LIMIT: Final = 12
"""Maximum number of blocks of a loop in a message."""


def check(mission: MissionDefinition) -> list[Remark]:
    """Finds livelocks, and chains of more blocks than the player executes in one step."""
    instant_or_short = {block.id: block for block in mission.blocks.values() if not _takes_time(block)}
    loop = _loop(instant_or_short)
    if loop:
        shown = loop if len(loop) <= SHOWN_LIMIT else (*loop[: SHOWN_LIMIT - 1], "…", loop[-1])
        message = (
            f"the loop {' → '.join(shown)} is a livelock: "
            f"expected a block in it that takes time, at least {REST_S:g} s"
        )
        return [Remark(loop[-1], "error", "livelock", message)]
    instant = {block.id: block for block in mission.blocks.values() if block.spec.instant}
    steps = _steps(instant)
    for block in mission.blocks.values():
        begins = block.type == BlockName.START or block.id not in instant
        targets = [edge.target for edge in block.edges] if begins else []
        longest = max((steps.get(target, 1) for target in targets), default=0)
        if longest + 1 >= STEPS_LIMIT:
            message = (
                f"{longest} blocks that take no time follow at once: expected fewer than {STEPS_LIMIT - 1}, "
                "a Wait between them"
            )
            return [Remark(block.id, "error", "instant-chain", message)]
    return []


def _takes_time(block: Block) -> bool:
    if isinstance(block.params, Wait):
        return block.params.duration_s >= REST_S
    return not block.spec.instant


def _loop(blocks: Mapping[str, Block]) -> tuple[str, ...]:
    """A cycle of these blocks, which begins and ends with the same one."""
    done: set[str] = set()
    for root in blocks:
        way: dict[str, int] = {}
        stack = [(root, 0)]
        while stack:
            name, index = stack.pop()
            if index == 0:
                if name in done:
                    continue
                way[name] = len(way)
            edges = blocks[name].edges
            if index == len(edges):
                del way[name]
                done.add(name)
                continue
            stack.append((name, index + 1))
            target = edges[index].target
            if target in way:
                return (*list(way)[way[target] :], target)
            if target in blocks and target not in done:
                stack.append((target, 0))
    return ()


def _steps(blocks: Mapping[str, Block]) -> dict[str, int]:
    """Maximum number of blocks that the player enters in one step from each of these."""
    found: dict[str, int] = {}
    for root in blocks:
        stack = [root]
        while stack:
            name = stack[-1]
            block = blocks[name]
            targets = [edge.target for edge in block.edges]
            missing = [target for target in targets if target in blocks and target not in found]
            if missing and name not in found:
                stack += missing
                continue
            stack.pop()
            counts = [found.get(target, 1) for target in targets]
            found[name] = 1 + (sum(counts) if block.type == BlockName.FORK else max(counts, default=0))
    return found
