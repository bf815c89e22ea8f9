"""Do the members' missions fit together? Barriers that all meet, blocks that the platforms can do."""

import msgspec

from swarmware.mission.catalogue import Barrier
from swarmware.mission.finding import Finding
from swarmware.mission.model import Block, Mission


class Role(msgspec.Struct, frozen=True):
    """A role's mission, bound for one of its platforms."""

    name: str
    kinds: tuple[str, ...]
    mission: Mission
    lines: dict[str, int]
    """Line of every block."""

    def finding(self, block: Block, rule: str, message: str) -> Finding:
        """An error at a block of this role's file."""
        line = self.lines.get(block.id, 0)
        return Finding(self.mission.file, line, block.pointer, "error", rule, message)


def check_roles(roles: list[Role]) -> list[Finding]:
    """Everything that fits each role but not all together."""
    return [*_capabilities(roles), *_barriers(roles)]


def _capabilities(roles: list[Role]) -> list[Finding]:
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


def _barriers(roles: list[Role]) -> list[Finding]:
    meets: dict[str, dict[str, tuple[Role, Block, Barrier]]] = {}
    for role in roles:
        for block in role.mission.barriers():
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
                message = f"barrier {barrier!r}: role {name!r} never comes to it; expected it in its mission"
                found.append(role.finding(block, "barrier", message))
        for other, other_block, other_params in members.values():
            if other.name not in wanted:
                message = f"barrier {barrier!r} is not for role {other.name!r}: expected {', '.join(wanted)}"
                found.append(other.finding(other_block, "barrier", message))
            elif (other_params.quorum, other_params.roles) != (params.quorum, params.roles):
                message = f"barrier {barrier!r}: quorum or roles differ from those of role {role.name!r}"
                found.append(other.finding(other_block, "barrier", message))
    return found
