"""Tables of the folder `reference` that follow from the code: each between two comments on its page."""

import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import command_schemas
import msgspec
from struct_tables import cell, field_docs

from swarmctl.membership.hosts import FleetFile, HostDefaults, HostEntry
from swarmd.control.core.modes import DECISIONS, TRANSITIONS, Source
from swarmware import errors
from swarmware.model import resource, template
from swarmware.model.acl import AclConfig
from swarmware.model.config import NodeConfig
from swarmware.service.channels import ChannelsConfig
from swarmware.service.config_keys import KeyDescription, described_keys, permitted, toml_type, without_none
from swarmware.service.installed import find, installed
from swarmware.types import control, registry
from swarmware.types.control import DriveEvent, DriveMode
from swarmware.types.units import UNITS

HERE = Path(__file__).parent / "reference"
TEMPLATES = HERE.parent.parent / "swarm" / "templates"


class Key(NamedTuple):
    """A key of a configuration file."""

    name: str
    """Dotted, `[]` after an array of tables."""
    type: str
    unit: str
    default: str
    range: str
    meaning: str


def row(*cells: str) -> str:
    """A row of a table."""
    return f"| {' | '.join(map(cell, cells))} |\n"


def head(*names: str) -> str:
    """The head of a table."""
    return row(*names) + "|---" * len(names) + "|\n"


def keys(cls: type[msgspec.Struct], prefix: str = "") -> Iterator[Key]:
    """Every key of a table of a configuration file, including keys of the tables inside it."""
    for one in described_keys(cls):
        name = f"{prefix}{one.name}"
        yield Key(name, one.type, one.unit, _default(one), one.limits, one.meaning)
        if one.item is not None:
            yield from keys(one.item, f"{name}[].")


def _default(one: KeyDescription) -> str:
    if one.required:
        return "required"
    if one.default is None:
        return "left out"
    if one.item is not None and one.default:
        return f"{len(one.default)} tables"
    return f"`{msgspec.json.encode(one.default).decode()}`"


def configuration() -> str:
    """Every key of every configuration file."""
    out = []
    for name, cls in _configurations():
        place = f"{name}.toml" if name in ("node", "acl", "channels") else f"services/{name}.toml"
        out.append(f"\n## {place}\n\n{cell(inspect.getdoc(cls) or '')}\n\n")
        out.append(head("key", "type", "unit", "default", "range", "meaning"))
        out += [row(f"`{key.name}`", *key[1:]) for key in keys(cls)]
    return "".join(out)


def _configurations() -> Iterator[tuple[str, type[msgspec.Struct]]]:
    yield "node", NodeConfig
    yield "acl", AclConfig
    yield "channels", ChannelsConfig
    for name, point in installed().items():
        # a package that is installed beside this one is not its part, and a part of a service has no file
        if point.value.startswith("swarmd.") and not (service := find(name)).settings_of:
            yield name, service.Config


def hosts() -> str:
    """The keys of a file of hosts."""
    shared = {one.name for one in described_keys(HostDefaults)}
    own = [key for key in keys(HostEntry, "hosts[].") if key.name.removeprefix("hosts[].") not in shared]
    rows = [*keys(HostDefaults, "defaults."), *own]
    columns = head("key", "type", "default", "range", "meaning")
    lines = [row(f"`{one.name}`", one.type, one.default, one.range, one.meaning) for one in rows]
    return "".join(["\n", inspect.getdoc(FleetFile) or "", "\n\n", columns, *lines])


def settings() -> str:
    """The live settings of each template."""
    out = []
    for found in template.whole(TEMPLATES):
        own = [one for one in found.resources if one.kind is resource.Kind.SETTING]
        if not own:
            continue
        out.append(f"\n## {found.name}\n\n" + head("setting", "type", "unit", "default", "range", "meaning"))
        for one in own:
            limits = f"[{one.range[0]:g}, {one.range[1]:g}]" if one.range else ", ".join(one.choices)
            out.append(row(f"`{one.path}`", one.type, one.unit, f"`{one.default}`", limits, one.description))
    return "".join(out)


def templates() -> str:
    """The format of templates, and the resources of each."""
    out = ["\n## Keys of a resource\n\n", head("key", "values", "meaning")]
    docs = field_docs(resource)
    info = msgspec.inspect.type_info(resource.Resource)
    assert isinstance(info, msgspec.inspect.StructType)
    fields = {field.name: field for field in info.fields}
    for name in template.Entry.__struct_fields__:
        kind = without_none(fields[name].type)
        values = permitted(kind) or toml_type(kind)
        out.append(row(f"`{name}`", values, docs.get(("Resource", name), "")))
    out += ["\nThe kinds:\n\n", head("kind", "meaning")]
    out += [row(f"`{kind.value}`", docs["Kind", kind.name]) for kind in resource.Kind]
    shared = {one.path for one in template.load("common", TEMPLATES).resources}
    for found in template.whole(TEMPLATES):
        kinds = ", ".join(f"`{kind.value}`" for kind in found.kinds)
        out.append(f"\n## {found.name}\n\n{cell(found.description)}; for platforms of kind {kinds}.\n\n")
        out.append(head("path", "kind", "type", "unit", "Hz", "meaning"))
        for one in found.resources:
            if one.path in shared or one.kind is resource.Kind.BRANCH:
                continue
            hz = f"{one.rate_hz:g}" if one.rate_hz else ""
            meaning = one.description or inspect.getdoc(registry.find(one.type)) or ""
            out.append(row(f"`{one.path}`", one.kind.value, one.type, one.unit, hz, meaning))
    return "".join(out)


SHARED_DOCUMENTS = {"message": "lines on stderr", "nodes": "a command at several nodes"}
"""Documents that do not belong to one command."""


def schemas() -> str:
    """The documents of the commands, and their schemas."""
    out = ["\n", head("command", "schema", "content")]
    for command in command_schemas.DOCUMENTS:
        module, _, name = command_schemas.DOCUMENTS[command].partition(":")
        cls = getattr(__import__(module, fromlist=[name]), name)
        file = f"{command.lower().replace(' ', '-')}.schema.json"
        called = SHARED_DOCUMENTS.get(command) or f"`swarmctl {command}`"
        link = f"[`{file}`](../../swarm/schemas/swarmctl/{file})"
        out.append(row(called, link, inspect.getdoc(cls) or ""))
    plain = ", ".join(f"`swarmctl {command}`" for command in sorted(command_schemas.NO_DOCUMENT))
    out.append(f"\nText or a file in every format: {plain}.\n")
    return "".join(out)


def exit_codes() -> str:
    """The exit codes, and the classes of errors that have them."""
    out = ["\n", head("class", "exit code", "raised for")]
    for name, cls in errors.KINDS.items():
        about = (inspect.getdoc(cls) or "").partition("\n\n")[0]
        out.append(row(f"`{name}`", str(cls.exit_code), about))
    return "".join(out)


def units() -> str:
    """The ends of names of fields, and their units."""
    return "".join(["\n", head("end of the name", "unit"), *(row(f"`{end}`", unit) for end, unit in UNITS)])


DRIVERS = {
    DriveMode.AUTO: "navigator, by its goal",
    DriveMode.MANUAL: "the operator who has the stick",
    DriveMode.HOLD: "no driver: the vehicle holds",
    DriveMode.PILOT: "the safety pilot; without its set-points the vehicle holds",
}


def modes() -> str:
    """The driver in each mode, and the mode after each event: the tables of the control daemon."""
    out = ["\n", head("mode", "who drives", *(f"set-points of the {source}" for source in Source))]
    for mode in DriveMode:
        decisions = [DECISIONS[mode, source].value for source in Source]
        out.append(row(f"`{mode}`", DRIVERS[mode], *decisions))
    out += ["\nThe mode after each event. `refused` means that the event changes nothing.\n\n"]
    out.append(head("event", *(f"in `{mode}`" for mode in DriveMode), "meaning"))
    meanings = field_docs(control)
    for event in DriveEvent:
        after = [TRANSITIONS[mode, event] for mode in DriveMode]
        cells = ["refused" if mode is None else f"`{mode}`" for mode in after]
        out.append(row(f"`{event}`", *cells, meanings["DriveEvent", event.name]))
    return "".join(out)


_GENERATED = re.compile(
    r"(<!-- from the code: [^>]*-->\n)(.*?)(<!-- end of what is from the code -->)", re.DOTALL
)


def page(path: Path, made: Callable[[], str]) -> str:
    """The page with the part between its two comments made from the code."""
    return _GENERATED.sub(lambda block: f"{block[1]}{made()}\n{block[3]}", path.read_text())


REFERENCE = {
    HERE / "configuration.md": configuration,
    HERE / "settings.md": settings,
    HERE / "hosts.md": hosts,
    HERE / "modes.md": modes,
    HERE / "templates.md": templates,
    HERE / "documents.md": schemas,
    HERE / "exit-codes.md": exit_codes,
    HERE / "library.md": units,
}
"""Functions that make the generated part of each page."""
