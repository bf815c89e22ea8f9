"""Assignment of roles to platforms, by kind and order, and of parameters to platforms."""

import msgspec

from swarmware.errors import MissionError
from swarmware.mission.binding import Binding
from swarmware.mission.folder import Folder, name_roles
from swarmware.mission.manifest import RoleSpec
from swarmware.model.names import natural
from swarmware.model.platform_kind import PlatformKind
from swarmware.types.mission import Member, ParamValue


class Platform(msgspec.Struct, frozen=True):
    """A platform that may get a role."""

    name: str
    kind: PlatformKind


class MemberAssignment(msgspec.Struct, frozen=True):
    """The role of one platform in a mission."""

    member: Member
    file: str
    binding: Binding


class Assignment(msgspec.Struct, frozen=True):
    """The roles of all platforms in a mission."""

    member_assignments: tuple[MemberAssignment, ...]
    """In the order of the roles, then of the platforms: the first present member opens a barrier."""
    left_out: tuple[str, ...]
    """Platforms without a role."""

    @property
    def members(self) -> tuple[Member, ...]:
        """The members of the ensemble, with their roles."""
        return tuple(assignment.member for assignment in self.member_assignments)


def assign(folder: Folder, platforms: list[Platform], overrides: dict[str, ParamValue]) -> Assignment:
    """Fills the roles in their order with platforms in natural order.

    Raises: MissionError when a required role stays empty or an override is not a parameter of the mission.
    """
    # refused, not ignored: a misspelt parameter would fly with its default
    unknown = sorted(overrides.keys() - folder.param_names())
    if unknown:
        known = ", ".join(sorted(folder.param_names())) or "it has none"
        raise MissionError(f"parameter {unknown[0]!r}: unknown in {folder.manifest.name}; expected {known}")
    free = sorted(platforms, key=lambda platform: natural(platform.name))
    # A platform that one role names is reserved for it: a general role must not take it before.
    named = {role.platform for role in folder.manifest.roles}
    filled: list[tuple[RoleSpec, list[Platform]]] = []
    for role in folder.manifest.roles:
        fitting = [
            platform
            for platform in free
            if platform.kind in role.kinds
            and (platform.name == role.platform if role.platform else platform.name not in named)
        ]
        taken = fitting[: role.take or None]
        if not taken and role.required:
            wanted = f"{role.platform!r}" if role.platform else f"no {' or '.join(role.kinds)}"
            expected = "it" if role.platform else "at least one"
            verb = "is not available" if role.platform else "is available"
            raise MissionError(f"role {role.name!r}: {wanted} {verb}; expected {expected}")
        filled.append((role, taken))
        # a platform has one role; the roles come in the order of the manifest
        free = [platform for platform in free if platform not in taken]
    first = {role.name: taken[0].name for role, taken in filled if taken}
    assignments: list[MemberAssignment] = []
    for role, taken in filled:
        for index, platform in enumerate(taken):
            # the later precedes: the operator over the role, the role over the mission
            params = {**folder.manifest.params, **folder.role_params(role, index), **overrides}
            binding = Binding(
                platform.name, platform.kind, role.name, folder.manifest.name, name_roles(params, first)
            )
            member = Member(platform.name, role.name, platform.kind)
            assignments.append(MemberAssignment(member, role.file, binding))
    return Assignment(tuple(assignments), tuple(platform.name for platform in free))
