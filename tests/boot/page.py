"""The commands of a page, with the section and the host that they are for."""

import re
from pathlib import Path
from typing import Final, NamedTuple

from tests.boot.machine import ROOT

PAGE: Final = ROOT / "share/doc/operations.md"
_BLOCK: Final = re.compile(
    r"^#{2,4} (?P<heading>[^\n]*)\n"
    r"|^(?:<!-- (?P<mark>host|not run): (?P<what>[^\n]*) -->\n)?```sh\n(?P<text>.*?)^```",
    re.MULTILINE | re.DOTALL,
)


class Block(NamedTuple):
    """One block of commands."""

    section: str
    host: str
    """Platform of the host that `<!-- host: … -->` names, or "" for each host."""
    text: str
    reason: str = ""
    """Why no test without systemd can run it (`<!-- not run: … -->`)."""


def blocks(page: Path) -> list[Block]:
    """The blocks of a page, in their order."""
    found, heading = [], ""
    for match in _BLOCK.finditer(page.read_text()):
        if match["heading"] is not None:
            heading = match["heading"]
        else:
            what = {match["mark"]: match["what"]}
            found.append(Block(heading, what.get("host", ""), match["text"], what.get("not run", "")))
    return found


def section(page: Path, heading: str, host: str = "", *, marked: bool = False) -> list[str]:
    """Blocks of a section for this host and for all hosts, with `marked` also blocks that need systemd."""
    found = [one for one in blocks(page) if one.section == heading and (marked or not one.reason)]
    return [one.text for one in found if not host or one.host in {"", host}]


def commands(text: str) -> list[str]:
    """Commands of a block as a person types them, each here-document as part of the line that begins it."""
    found: list[str] = []
    end = ""
    for line in text.splitlines():
        if end:
            found[-1] += f"\n{line}"
            end = "" if line == end else end
            continue
        if line.strip() and not line.startswith("#"):
            found.append(line)
            document = re.search(r"<<'?(\w+)'?", line)
            end = document[1] if document else ""
    return found
