"""Writes the part of the documentation that follows from the code and from a measured run: `make docs`.

With the folder of a report (`make figures`) that run is the one whose figures and paths the README shows.
"""

import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import msgspec

from swarmctl.lab import report
from swarmctl.main import cli

HERE = Path(__file__).parent
README = HERE.parent.parent / "README.md"
MEASURED = HERE / "formation-16.json"
"""The report.json of the run that the README shows."""
PICTURE = HERE / "paths.png"

_FIGURES = re.compile(r"(<!-- figures: [^>]*-->\n)(.*?)(<!-- end of figures -->)", re.DOTALL)

_HEAD = """# swarmctl

One command for the whole swarm. This page is generated from the help texts by `make docs`;
a test holds it against them.

stdout is the result, stderr is talk. `--json` always works: one document per call, JSON Lines where it
goes on; every document has a `schema_version`. A command joins the node that `--config DIR` names, else the
ground station of the lab that `--lab NAME` names, else the node of `SWARM_CONFIG` (which daemons and modules
read, too), else the ground station of a running lab, else `/etc/swarm`; `--node PLATFORM` says which platform
is asked about. Every other option is also read from the environment: `SWARMCTL_NODE`, `SWARMCTL_JSON` …

| exit code | means |
|---|---|
| 0 | done |
| 1 | failed |
| 2 | usage |
| 3 | partial: some members did not, or data was lost |
| 4 | no answer in time |
| 5 | denied |
| 6 | not found |
| 7 | invalid input: a file, a value, a mission |
| 130 | interrupted |

`swarmctl doctor` exits with 0 healthy, 1 warnings, 2 errors.
`eval "$(swarmctl completion bash)"` completes words; zsh and fish too.
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
    shared = {id(param) for param in getattr(command, "_shared", [])}
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
    found = msgspec.json.decode(MEASURED.read_bytes(), type=report.Report)
    table = f"\n{report.markdown(found)}\nMeasured on {found.host.summary()}.\n\n"
    return _FIGURES.sub(lambda block: block[1] + table + block[3], README.read_text())


PAGES = {HERE / "cli.md": cli_page, README: readme}


def main(folder: str = "") -> int:
    """Writes the pages; with a report's folder that report is taken over first."""
    if folder:
        shutil.copyfile(Path(folder) / "report.json", MEASURED)
        shutil.copyfile(Path(folder) / "paths.png", PICTURE)
    for path, make in PAGES.items():
        text = make()
        if not path.exists() or path.read_text() != text:
            path.write_text(text)
            sys.stdout.write(f"{path}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:2]))
