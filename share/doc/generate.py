"""Writes the part of the documentation that follows from the code and from a measured run: `make docs`.

With the folder of a report (`make figures`) that run is the one whose figures and paths the README shows.
"""

import ast
import inspect
import json
import re
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import click
import msgspec

import swarmware.types
from swarmctl.commandline.arguments import meaning
from swarmctl.main import cli
from swarmd.tree.core.structure import structure
from swarmlab.report import report
from swarmware.model import resource, template
from swarmware.model.acl import AclConfig
from swarmware.service.channels import ChannelsConfig
from swarmware.transport.appfile import entry

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import command_schemas  # noqa: E402 - beside this file, which tests load by its path
import mission_pages  # noqa: E402 - beside this file, which tests load by its path
import reference_pages  # noqa: E402 - beside this file, which tests load by its path
from file_schemas import hosts_schema, manifest_schema, mission_schema  # noqa: E402 - as above
from struct_tables import cell, field_docs, struct_section  # noqa: E402 - as above

README = HERE.parent.parent / "README.md"
MEASURED = HERE / "formation-16.json"
"""The report.json of the run that the README shows."""
PICTURE = HERE / "paths.png"
SCHEMAS = HERE.parent / "swarm" / "schemas" / "swarmctl"
REQUIREMENTS = HERE / "requirements.md"
ARCHITECTURE = HERE / "architecture.md"
ROOT = HERE.parent.parent
PACKAGES = ("lib/swarmware", "daemons/swarmd", "cli/swarmctl", "cli/swarmlab")
SOURCES = ("S0", "S1", "S2", "S3", "S4")
"""Sources of the capabilities on the page of requirements."""

_PACKAGES = re.compile(r"(<!-- packages: [^>]*-->\n)(.*?)(<!-- end of packages -->)", re.DOTALL)
_FIGURES = re.compile(r"(<!-- figures: [^>]*-->\n)(.*?)(<!-- end of figures -->)", re.DOTALL)

_STATES = re.compile(r"(<!-- states: [^>]*-->\n)(.*?)(<!-- end of states -->)", re.DOTALL)

_HEAD = """# swarmctl

`swarmctl` is the one command for the whole swarm. This page lists all its commands with their options.
`make docs` generates it from the help texts, and a test compares the two.

## Results

stdout is the result, and stderr has the messages. Every command accepts `-o FORMAT`:

| format | result |
|---|---|
| `table` | a table, with colours on a terminal |
| `wide` | the table with all its columns |
| `json` (or `--json`) | one JSON document per call; JSON Lines if the result is continuous |
| `jsonl` | JSON Lines: one document per item of a list |
| `yaml` | YAML documents |

Every JSON document and line has a `schema_version`. `share/swarm/schemas/swarmctl/` has the JSON Schema of
each command, also of the lines on stderr (`message.schema.json`): with a structured result errors, warnings
and messages are JSON, too. Instants and durations in nanoseconds (`…_ns`) and 64-bit identities are text.
Every other integer beyond 2^53 is text as well, because a reader with double precision would change it.

Control characters of values, names and reasons are shown as escape sequences, `\\x1b`, `\\n` or `\\u202e`,
also invisible characters and characters that change the direction of text. JSON and YAML have them as
`\\u009b`. Result files (`--out`, `tree dump`) have them unchanged, except on a terminal.

## Node and environment

A command joins the first node that applies:

1. the node that `--config DIR` names,
2. the ground station of the lab that `--lab NAME` names,
3. the node of `SWARM_CONFIG`, which daemons and modules read, too,
4. the ground station of a running lab,
5. the node of `/etc/swarm`.

`--node PLATFORM` selects the platform of the request. Every other option is also read from the environment:
`SWARMCTL_NODE`, `SWARMCTL_JSON` … A variable that is set and empty counts as not set. An empty `--node ""` on
the command line is refused.

## Several nodes

Every command that takes nodes takes several: `-n uav1,uav2`, `-n uav1 -n uav2`, `-n 'uav*'`, `-n 'uav{1,3}'`,
`--all` (the same as `-n '*'`). A selection is the text between the braces of a
[path pattern](reference/paths.md); each of its parts must match a known platform. Arguments `PLATFORM…` have
the same form, and precede `--node`.

The command runs at all selected nodes at the same time and prints one result: a table with the column NODE,
in which a node that failed has its error in its row. As a document the result is
[`nodes.schema.json`](reference/documents.md): a list with the platform, the document of the command as for
one node, the error and the exit code of each. With one name the command prints its own document. Commands
whose own document has a platform per item (`node ls`, `health ls`, `app ls`, `topo`, `tree`, `log`, and the
commands that move vehicles) keep it. If a confirmation is needed, one question names all nodes.
`mission start` acts through one ground station, and `kill` on one vehicle.

## Exit codes

| exit code | means |
|---|---|
| 0 | done |
| 1 | failed |
| 2 | usage |
| 3 | partial: some members did not succeed, or data was lost |
| 4 | no answer in time |
| 5 | denied |
| 6 | not found |
| 7 | invalid input: a file, a value, a mission |
| 130 | interrupted |

With several nodes the exit code is 0 if all nodes succeeded, and 3 if some failed. If all failed, it is the
code of the failure, or 1 if they failed differently. `swarmctl doctor` exits with 0 healthy, 1 warnings,
2 errors.

## Completion

`eval "$(swarmctl completion bash)"` completes words; zsh and fish are supported, too.
"""


def commands(
    group: click.Group, ctx: click.Context, words: str
) -> Iterator[tuple[str, click.Command, click.Context]]:
    """Every command below a group, in the order of the help."""
    for name in group.list_commands(ctx):
        command = group.get_command(ctx, name)
        if command is None or command.hidden:
            continue
        inner = click.Context(command, info_name=name, parent=ctx)
        full = f"{words} {name}"
        if isinstance(command, click.Group):
            yield full, command, inner
            yield from commands(command, inner, full)
        else:
            yield full, command, inner


def own_options(command: click.Command) -> list[click.Option]:
    """Options of this command, without those of every command."""
    shared = {id(param) for param in getattr(command, "shared", [])}
    return [p for p in command.params if isinstance(p, click.Option) and id(p) not in shared and not p.hidden]


def cli_page() -> str:
    """The page of all commands."""
    root = click.Context(cli, info_name="swarmctl")
    out = [_HEAD]
    for words, command, ctx in commands(cli, root, "swarmctl"):
        about, _, example = (command.help or "").partition("Example:")
        if isinstance(command, click.Group):
            out.append(f"\n## {words}\n\n{' '.join(about.split())}\n")
            continue
        pieces = " ".join(command.collect_usage_pieces(ctx))
        level = "##" if words.count(" ") == 1 else "###"
        out.append(f"\n{level} {words}\n\n{' '.join(about.split())}\n")
        out.append(f"\n    {words} {pieces}\n    $ {' '.join(example.split())}\n")
        arguments = [param for param in command.params if isinstance(param, click.Argument)]
        if arguments:
            out.append("\n| argument | |\n|---|---|\n")
            for one in arguments:
                name = one.human_readable_name.replace("|", "\\|")
                out.append(f"| `{name}` | {cell(meaning(words, one.name or ''))} |\n")
        rows = [record for option in own_options(command) if (record := option.get_help_record(ctx))]
        if rows:
            out.append("\n| option | |\n|---|---|\n")
            out += [
                f"| `{name}` | {' '.join(text.split()).replace('|', chr(92) + '|')} |\n"
                for name, text in rows
            ]
    return "".join(out)


def readme() -> str:
    """The README with the table of the measured run."""
    found = msgspec.json.decode(MEASURED.read_bytes(), type=report.ExperimentReport)
    table = f"\n{report.markdown(found)}\nMeasured on {found.host.summary()}.\n\n"
    return _FIGURES.sub(lambda block: block[1] + table + block[3], README.read_text())


_TYPES_HEAD = """# Payload types

This page defines the payloads of [the protocol](protocol.md). `make docs` generates it from the types in the
code and from the templates; a test compares them.

A payload is the MessagePack of its type. For a type that is an **array** it is the array of the fields in the
given order: fields at the end that have a default may be missing, and further items are ignored. For
a type that is a **map** it is a map with the names of the fields as keys: a field that has a default may be
missing, unknown keys are ignored. No type has a tag. The name of a type is part of the data id: an
incompatible change of a type needs a new name.

| here | MessagePack |
|---|---|
| `bool` | boolean |
| `int` | integer of 64 bits, in the shortest form; a range in brackets applies to received values |
| `float` | float 64; a receiver takes an integer, too |
| `text` | string, UTF-8 |
| `bytes` | binary |
| `[T]` | array of any length |
| `[T, U]` | array of exactly these items |
| `{T: U}` | map |
| `T?` | T or nil |
| `"a" \\| "b"` | string; an unknown value is kept unchanged, except for levels and phases of health |

Units are SI. Instants end in `_ns` and are readings of a hardware clock, or of the wall clock where they end
in `utc_ns`. World coordinates are east, north, up; body coordinates forward, left, up (REP-103).
"""

_PATHS_HEAD = """
## Addresses of every platform

These are the resources of the template `common`, which the daemons of every node provide. The path, a colon
and the name of the type give the data id; for a command it is the type of the request. Vehicles have more
resources: `swarmctl tree ls`.

| path | kind | type | answer | on links |
|---|---|---|---|---|
"""


def types_page() -> str:
    """The page of all payload types."""
    out = [_TYPES_HEAD]
    out.append(_PATHS_HEAD)
    for one in template.load("common", HERE.parent / "swarm" / "templates").resources:
        if one.kind is not resource.Kind.BRANCH:
            reply = one.reply and f"[{one.reply}](#{one.reply.lower()})"
            out.append(
                f"| `{one.path}` | {one.kind} | [{one.type}](#{one.type.lower()}) | {reply} | {one.link} |\n"
            )
    for found in iter_modules(swarmware.types.__path__):
        module = import_module(f"swarmware.types.{found.name}")
        own = [
            cls
            for cls in vars(module).values()
            if isinstance(cls, type)
            and issubclass(cls, msgspec.Struct)
            and cls.__module__ == module.__name__
            and swarmware.types.registry.known(cls)
        ]
        if own:
            docs = field_docs(module)
            about = cell(inspect.getdoc(module) or "")
            out.append(f"\n## Types of {found.name}\n\n{about} In Python: `{module.__name__}`.\n")
            out += [struct_section(cls, docs) for cls in own]
    out.append("\n## Descriptors\n\nThese types are parts of payloads and files, not payloads themselves.\n")
    for module, classes in (
        (resource, (resource.Resource,)),
        (structure, (structure.Changes,)),
        (entry, (entry.AppEntry, entry.Served)),
    ):
        docs = field_docs(module)
        out += [struct_section(cls, docs) for cls in classes]
    return "".join(out)


def packages_table() -> str:
    """The packages of the code with the purpose in their docstrings, and the packages inside them."""
    rows = ["\n| package | content | packages inside |\n|---|---|---|\n"]
    for top in (ROOT / name for name in PACKAGES):
        for folder in (top, *sorted(path.parent for path in top.glob("*/__init__.py"))):
            purpose = ast.get_docstring(ast.parse((folder / "__init__.py").read_text())) or ""
            inside = sorted(path.parent for path in folder.glob("*/**/__init__.py")) if folder != top else []
            rooms = ", ".join(f"`{room.relative_to(folder)}`" for room in inside)
            line = " ".join(purpose.partition("\n\n")[0].split())
            rows.append(f"| `{folder.relative_to(top.parent)}` | {line} | {rooms} |\n")
    return "".join(rows) + "\n"


def architecture() -> str:
    """The page of the architecture with the packages as they are."""
    return _PACKAGES.sub(lambda block: block[1] + packages_table() + block[3], ARCHITECTURE.read_text())


def requirements() -> str:
    """The page of requirements with the number of capabilities in each state."""
    text = REQUIREMENTS.read_text()
    states = re.findall(
        r"^\| (S\d)\.\d+ \| .* \| (done|part|none|later)\b[^|]* \| [^|]*\|$", text, re.MULTILINE
    )
    count = Counter(states)
    rows = ["\n| source | done | part | none, later | all |\n|---|---|---|---|---|\n"]
    for name, sources in [*((source, [source]) for source in SOURCES), ("all", SOURCES)]:
        done, part, none, later = (
            sum(count[source, state] for source in sources) for state in ("done", "part", "none", "later")
        )
        rows.append(f"| {name} | {done} | {part} | {none + later} | {done + part + none + later} |\n")
    return _STATES.sub(lambda block: block[1] + "".join(rows) + "\n" + block[3], text)


def template_schema() -> str:
    """The JSON Schema of template files."""
    return json.dumps(template.schema(), indent=2) + "\n"


def acl_schema() -> str:
    """The JSON Schema of the file of access rules."""
    return msgspec.json.format(msgspec.json.encode(msgspec.json.schema(AclConfig)), indent=2).decode() + "\n"


def channels_schema() -> str:
    """The JSON Schema of the file of channels."""
    schema = msgspec.json.schema(ChannelsConfig)
    return msgspec.json.format(msgspec.json.encode(schema), indent=2).decode() + "\n"


PAGES: dict[Path, Callable[[], str]] = {
    HERE / "cli.md": cli_page,
    HERE / "types.md": types_page,
    README: readme,
    REQUIREMENTS: requirements,
    ARCHITECTURE: architecture,
    SCHEMAS.parent / "template.schema.json": template_schema,
    SCHEMAS.parent / "acl.schema.json": acl_schema,
    SCHEMAS.parent / "channels.schema.json": channels_schema,
    SCHEMAS.parent / "mission.schema.json": mission_schema,
    SCHEMAS.parent / "manifest.schema.json": manifest_schema,
    SCHEMAS.parent / "hosts.schema.json": hosts_schema,
    **{
        path: partial(reference_pages.page, path, made)
        for path, made in (reference_pages.REFERENCE | mission_pages.REFERENCE).items()
    },
}


def schemas_of_commands() -> Iterator[tuple[Path, str]]:
    """The JSON Schemas of the documents of the commands."""
    for name, schema in command_schemas.schemas():
        yield SCHEMAS / name, msgspec.json.format(msgspec.json.encode(schema), indent=1).decode() + "\n"


def main(folder: str = "") -> int:
    """Writes the pages; with a report's folder that report is taken over first."""
    if folder:
        shutil.copyfile(Path(folder) / "report.json", MEASURED)
        shutil.copyfile(Path(folder) / "paths.png", PICTURE)
    for path, text in (*((path, make()) for path, make in PAGES.items()), *schemas_of_commands()):
        if not path.exists() or path.read_text() != text:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text)
            sys.stdout.write(f"{path}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:2]))
