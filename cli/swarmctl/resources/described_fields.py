"""Fields of the types that applications of this machine describe in their files, for completion."""

from collections.abc import Collection

import msgspec

from swarmctl.session import labs
from swarmctl.session.session import Session
from swarmware.errors import SwarmError
from swarmware.transport.appfile import table
from swarmware.types.described import class_of
from swarmware.types.description import TypeDescription
from swarmware.types.field_values import field_values

_decoder = msgspec.json.Decoder(TypeDescription)


def described_fields(
    session: Session, platforms: Collection[str], types: Collection[str]
) -> dict[str, dict[str, list[str]]]:
    """Fields by the name of the type, of platforms on this machine; an invalid description is left out."""
    lab = labs.chosen(session.settings)
    if lab is None:
        folders = [session.module.node.config.run_path] if session.here in platforms else []
    else:
        folders = [node.run_dir for node in lab.nodes if node.platform in platforms]
    found: dict[str, dict[str, list[str]]] = {}
    for entry in (entry for folder in folders for entry in table.scan(folder)):
        for name in entry.types.keys() & types:
            try:
                found[name] = field_values(class_of(_decoder.decode(entry.types[name])))
            except (msgspec.DecodeError, ValueError, RecursionError, SwarmError):
                continue  # as without a description
    return found
