"""The checks of a node's keys: present, private, of a member of the swarm, and in time."""

import os
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Literal, NamedTuple

from swarmware.errors import Denied, SwarmError
from swarmware.transport.security.keys import NODE_KEY, ROSTER, Keys

CLOCK_S: Final = 60.0
"""Time by which a clock must be before the file it has written, to be reported: file systems round stamps."""
INVITE: Final = "`swarmctl keys invite {platform}` at the operator's, then"


class KeyFinding(NamedTuple):
    """Result of one check of the keys."""

    verdict: Literal["ok", "warning", "error"]
    text: str
    advice: str = ""


def check_keys(folder: Path, platform: str, utc_s: float) -> Iterator[KeyFinding]:
    """What is found in a node's folder of keys; `utc_s`: the wall clock of this computer."""
    invite = INVITE.format(platform=platform)
    if folder.exists() and not os.access(folder, os.R_OK | os.X_OK):
        yield KeyFinding("ok", f"{folder} is not readable by this user, which is not needed")
        return
    if not (folder / NODE_KEY).exists():
        advice = f"`swarmctl keys init` for a new swarm, or {invite} `swarmctl keys join TOKEN` here"
        text = f"{folder}: no {NODE_KEY}: the node serves only this computer, and all users of it"
        yield KeyFinding("warning", text, advice)
        return
    try:
        Keys.load(folder, platform)
    except Denied as error:
        again = f"{invite} `swarmctl keys join --replace TOKEN`"
        # the same class covers a wrong mode and a missing membership, with different remedies
        advice = f"chmod 0600 {folder}/{NODE_KEY}" if "mode" in str(error) else again
        yield KeyFinding("error", str(error), advice)
    except SwarmError as error:
        yield KeyFinding("error", str(error), f"{invite} `swarmctl keys join --replace TOKEN`")
    else:
        yield KeyFinding("ok", f"identity and roster in {folder}")
    if (folder / ROSTER).exists():
        written_s = (folder / ROSTER).stat().st_mtime
        if utc_s < written_s - CLOCK_S:
            text = f"the clock says {_date(utc_s)}, and the roster was written at {_date(written_s)}"
            yield KeyFinding("warning", text, "set the clock: date --set, or NTP")


def _date(utc_s: float) -> str:
    return datetime.fromtimestamp(utc_s, UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
