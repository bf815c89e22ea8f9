"""Seeds of a node's broker: addresses at which a new member finds the others without multicast."""

import json
import re
from typing import Final

import msgspec

from swarmctl.membership.node_keys import NodeKeys
from swarmware.errors import ConfigError
from swarmware.model import document, paths
from swarmware.model.config import load_service
from swarmware.runtime.filewriter import replace_file
from swarmware.service.installed import find

BROKER: Final = "broker"
MODE: Final = 0o644
_LINE: Final = re.compile(r"(?m)^seeds = \[[^\]\n]*\]$")


def unicast_port(node: NodeKeys) -> int:
    """Fixed UDP port at which others reach the broker of this node, or 0 if it changes with each start.

    Raises: ConfigError.
    """
    config = load_service(node.config_dir, BROKER, find(BROKER).Config)
    return int(msgspec.structs.asdict(config)["unicast_port"])


def add_seed(node: NodeKeys, seed: str) -> bool:
    """Enters a seed in the broker's file; returns False if it was there already.

    Raises: ConfigError when the file is invalid, or its line of seeds is ambiguous; OSError.
    """
    path = paths.service_config(node.config_dir, BROKER)
    config = load_service(node.config_dir, BROKER, find(BROKER).Config)
    present = [*msgspec.structs.asdict(config)["seeds"]]
    if seed in present:
        return False
    wanted = [*present, seed]
    before = document.read(path) if path.exists() else ""
    line = f"seeds = {json.dumps(wanted)}"
    # the line is replaced as text, which keeps the operator's comments; the result is parsed as a check
    after, count = _LINE.subn(lambda _match: line, before, count=1)
    if not count:  # at the top, because below the header of a table it would be a key of that table
        after = f"{line}\n{before}"
    if document.toml(after, str(path)).get("seeds") != wanted:
        raise ConfigError(f"{path}: the line of key seeds is not clear; expected {line!r} by hand")
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, after.encode(), mode=MODE)
    return True
