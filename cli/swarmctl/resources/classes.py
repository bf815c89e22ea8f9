"""Payload types by their names: installed classes, and types that a platform describes."""

import msgspec

from swarmctl.commandline import word_cache
from swarmctl.session.session import Session, config_dir
from swarmware.errors import NoAnswer, NotFound
from swarmware.model.names import join
from swarmware.types import registry
from swarmware.types.description import TypeDescription, describe
from swarmware.types.field_values import field_values
from swarmware.types.tree import TypeRequest


async def described(session: Session, platform: str, name: str) -> TypeDescription:
    """Description of a type, from its class if it is installed here, else from the platform.

    Raises: NotFound, NoAnswer, WireError.
    """
    if not registry.installed(name):
        request = TypeRequest(name, "" if platform == session.here else platform)
        about = join(platform, "sys/tree/type")
        return await session.ask(join(session.here, "sys/tree/type"), request, TypeDescription, about=about)
    return describe(registry.find(name))


async def described_anywhere(session: Session, name: str) -> TypeDescription:
    """The description of a type by the first platform that has it, the joined one first.

    Raises: NotFound.
    """
    known = await session.platforms()
    for platform in sorted(known, key=lambda one: one != session.here):
        try:
            return await described(session, platform, name)
        except (NotFound, NoAnswer):
            continue
    raise NotFound(f"type {name!r}: no platform describes it; expected a type that `swarmctl tree ls` shows")


async def payload_class(session: Session, platform: str, name: str) -> type[msgspec.Struct] | None:
    """Class of a type, or None if it is neither installed here nor described by its platform.

    Raises: WireError for an invalid description.
    """
    if registry.installed(name):
        return registry.find(name)
    from swarmware.types.described import class_of  # it imports the parser of Python

    key = (platform, name)
    if key not in session.classes:
        try:
            session.classes[key] = found = class_of(await described(session, platform, name))
            word_cache.save(str(config_dir(session.settings)), fields={name: field_values(found)})
        except (NotFound, NoAnswer):
            session.classes[key] = None
    return session.classes[key]


async def known_class(session: Session, platform: str, name: str) -> type[msgspec.Struct]:
    """The class of a type whose values are to be sent or compared.

    Raises: NotFound when it is neither installed here nor described by its platform.
    """
    found = await payload_class(session, platform, name)
    if found is None:
        raise NotFound(f"type {name!r}: not installed here, and {platform} does not describe it")
    return found
