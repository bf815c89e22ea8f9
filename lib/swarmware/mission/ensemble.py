"""Checks the missions of an ensemble together: matching barriers, blocks that the platforms can execute."""

from collections.abc import Callable

import msgspec

from swarmware.mission.budget import Budget
from swarmware.mission.catalogue import Barrier
from swarmware.mission.finding import TOO_LARGE, Finding, Severity
from swarmware.mission.meetings import Failure, TooLarge, search
from swarmware.mission.model import Block, MissionDefinition
from swarmware.mission.outcome import BARRIER_BROKEN, TIMED_OUT
from swarmware.mission.participant import Participant
from swarmware.model.platform_kind import PlatformKind

PARALLEL = 4
"""Number of simultaneous barriers from which they are reported as the reason of a too large check."""
BLOCKS_SHOWN = 4

COPIES_LIMIT = 3
"""Maximum members of one role that are explored; two suffice unless a quorum exceeds two."""


class EnsembleRole(msgspec.Struct, frozen=True):
    """The mission of a role, bound to one of its platforms."""

    name: str
    kinds: tuple[PlatformKind, ...]
    mission: MissionDefinition
    take: int
    """Number of platforms with this role, or 0 for any number."""
    line: Callable[[str], int]
    """Line of a JSON pointer."""

    def finding(
        self,
        block: Block,
        rule: str,
        message: str,
        severity: Severity = "error",
        trace: tuple[str, ...] = (),
    ) -> Finding:
        """A finding at a block in this role's file."""
        line = self.line(block.pointer)
        return Finding(self.mission.file, line, block.pointer, severity, rule, message, trace)


def check_roles(roles: list[EnsembleRole]) -> list[Finding]:
    """Findings that concern several roles together."""
    return [*_capabilities(roles), *_barriers(roles), *_quorums(roles), *_without_successor(roles)]


def check_meetings(roles: list[EnsembleRole], budget: Budget) -> list[Finding]:
    """Findings about members of these roles that wait for each other without end, or fail at a barrier."""
    # without barriers no role waits for another one, and the search has nothing to find
    if not any(role.mission.barriers for role in roles):
        return []
    found = search([_part(role) for role in roles], budget)
    if found is None:
        return []
    role = next(role for role in roles if role.name == found.role)
    if isinstance(found, TooLarge):
        shown = ", ".join(found.blocks[:BLOCKS_SHOWN]) + (", …" if len(found.blocks) > BLOCKS_SHOWN else "")
        message = (
            f"too large to check: more states than the check explores; role {role.name!r} can wait at "
            f"{len(found.blocks)} barriers at the same time ({shown}), which open in any order; expected "
            "fewer in parallel, or one barrier after the Join of their branches"
            if found.at_once and len(found.blocks) >= PARALLEL
            else "too large to check: more states than the check explores, with all ways of all members to "
            f"the barriers of role {role.name!r} ({shown}); expected fewer choices before barriers"
        )
        return [role.finding(role.mission.blocks[found.blocks[0]], TOO_LARGE, message, "unknown")]
    block = role.mission.blocks[found.block]
    if isinstance(found, Failure):
        message = (
            f"role {role.name!r} fails in every run without a fault: {found.message}; "
            "expected the same visits of each barrier in all roles, or a nextTimeout"
            if found.certain
            else f"role {role.name!r} fails in this run: {found.message}; expected a nextTimeout, or the "
            "same visits of each barrier on every path"
        )
        severity: Severity = "error" if found.certain else "warning"
        return [role.finding(block, "unequal-visits", message, severity, found.trace)]
    return [role.finding(block, "barrier", found.message, trace=found.trace)]


def _part(role: EnsembleRole) -> Participant:
    quorums = [
        block.params.quorum
        for block in role.mission.barriers
        if isinstance(block.params, Barrier) and isinstance(block.params.quorum, int)
    ]
    station = role.kinds == (PlatformKind.GCS,)
    # two members suffice to find a pair that waits for each other; a station is alone
    copies = min(COPIES_LIMIT, max(1 if station else 2, *quorums, 1), role.take or COPIES_LIMIT)
    if quorums:  # their number decides whether the barrier opens
        copies = min(COPIES_LIMIT, role.take or copies)
    return Participant(role.name, role.mission, copies, role.take, station)


def _quorums(roles: list[EnsembleRole]) -> list[Finding]:
    found: list[Finding] = []
    for role in roles:
        for block in role.mission.barriers:
            params = block.params
            if not isinstance(params, Barrier) or not isinstance(params.quorum, int):
                continue
            meeting = [other for other in roles if not params.roles or other.name in params.roles]
            available = sum(other.take for other in meeting)
            # a role of any number of members may always reach the quorum
            if all(other.take for other in meeting) and params.quorum > available:
                message = (
                    f"barrier {params.id!r}: a quorum of {params.quorum}, but its roles take "
                    f'{available} members; expected at most {available}, or "all"'
                )
                found.append(role.finding(block, "barrier", message))
    return found


def _without_successor(roles: list[EnsembleRole]) -> list[Finding]:
    """Findings of barriers that have no successor for the loss of a member."""
    found: list[Finding] = []
    for role in roles:
        for block in role.mission.barriers:
            if block.successor(BARRIER_BROKEN) is None and block.successor(TIMED_OUT) is None:
                message = (
                    f"when barrier {block.id!r} breaks (a member was lost, or failed), this mission fails; "
                    'expected nextTimeout, or on: {"broken": …}'
                )
                found.append(role.finding(block, "broken-barrier", message, "warning"))
    return found


def _capabilities(roles: list[EnsembleRole]) -> list[Finding]:
    found: list[Finding] = []
    for role in roles:
        for block in role.mission.blocks.values():
            for kind in role.kinds:
                if block.spec.kinds and kind not in block.spec.kinds:
                    able = " or ".join(block.spec.kinds)
                    message = (
                        f"role {role.name!r} can be a {kind}, which cannot {block.type}: expected {able}"
                    )
                    found.append(role.finding(block, "capability", message))
    return found


def _barriers(roles: list[EnsembleRole]) -> list[Finding]:
    meets: dict[str, dict[str, tuple[EnsembleRole, Block, Barrier]]] = {}
    for role in roles:
        for block in role.mission.barriers:
            if isinstance(block.params, Barrier):
                meets.setdefault(block.params.id, {}).setdefault(role.name, (role, block, block.params))
    names = [role.name for role in roles]
    found: list[Finding] = []
    for barrier, members in meets.items():
        role, block, params = next(iter(members.values()))
        wanted = params.roles or tuple(names)
        for name in wanted:
            if name not in names:
                message = f"barrier {barrier!r}: role {name!r} does not exist; expected {', '.join(names)}"
                found.append(role.finding(block, "barrier", message))
            elif name not in members:
                message = f"barrier {barrier!r}: role {name!r} never reaches it; expected it in its mission"
                found.append(role.finding(block, "barrier", message))
        for other, other_block, other_params in members.values():
            if other.name not in wanted:
                message = f"barrier {barrier!r} is not for role {other.name!r}: expected {', '.join(wanted)}"
                found.append(other.finding(other_block, "barrier", message))
            elif (other_params.quorum, other_params.roles) != (params.quorum, params.roles):
                message = f"barrier {barrier!r}: quorum or roles differ from role {role.name!r}"
                found.append(other.finding(other_block, "barrier", message))
    return found
