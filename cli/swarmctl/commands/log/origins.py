"""Origins of the maps in which nodes have their positions: by the configuration of their navigators."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from swarmctl.commandline.settings import CliSettings
from swarmctl.session import labs
from swarmctl.session.session import config_dir
from swarmctl.terminal.output import Output
from swarmware.errors import ConfigError
from swarmware.geometry.geodesy import Origin
from swarmware.geometry.world import World
from swarmware.model import paths
from swarmware.model.config import load, load_node, load_service


class _Navigator(msgspec.Struct, frozen=True):
    """Key of navigator.toml: the file with the origin."""

    world: str = "formation"


def origins(options: Mapping[str, Any], out: Output) -> dict[str, Origin]:
    """Origin by platform, of the nodes on this machine whose rings the options name.

    A folder, database or spool does not state the origin of its maps: empty. A node whose configuration is
    invalid is left out, with a warning: its log can be read all the same.
    """
    found: dict[str, Origin] = {}
    # recorded elsewhere or earlier: the present configuration says nothing about their maps
    if not any(options.get(key) for key in ("folder", "mongodb", "spool")):
        for platform, folder in _nodes(out.settings):
            try:
                found[platform] = _origin(folder)
            except ConfigError as error:
                out.warn(f"no position of {platform} on the map panel: {error}")
    return found


def _nodes(settings: CliSettings) -> list[tuple[str, Path]]:
    """Platforms and configuration folders."""
    lab = labs.chosen(settings)
    if lab is not None:
        return [(node.platform, node.config_dir) for node in lab.select(settings.node)]
    folder = config_dir(settings)
    return [(load_node(folder).platform, folder)]


def _origin(folder: Path) -> Origin:
    name = load_service(folder, "navigator", _Navigator).world
    return load(paths.world(load_node(folder).share_path, name), World).origin
