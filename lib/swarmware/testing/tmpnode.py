"""A node in a temporary folder: its configuration, and this process attached to it."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import msgspec
import tomli_w

from swarmware.model import paths
from swarmware.model.config import NodeConfig, convert
from swarmware.model.names import Address
from swarmware.node.node import Node


def make_node(
    root: Path, platform: str = "uav1", *, services: Mapping[str, Any] | None = None, **settings: Any
) -> Path:
    """Configuration folder of a node whose files are all below `root/<platform>`.

    `platform`: its name, with its unit where that is not `main`: `uav1.fc`. `settings`: keys of node.toml;
    `services`: name → settings, or a Struct, of services/<name>.toml.
    """
    folder = root / platform
    address = Address.parse(platform)
    raw = {
        "platform": address.platform,
        "unit": address.unit,
        "run_dir": str(folder / "run"),
        "shm_dir": str(folder / "shm"),
        "data_dir": str(folder / "data"),
        "keys_dir": str(folder / "keys"),
        "services": list(services or ()),
        **settings,
    }
    convert(raw, NodeConfig, "settings of the test")
    config_dir = folder / "etc"
    (config_dir / "services").mkdir(parents=True)
    (config_dir / "node.toml").write_text(tomli_w.dumps(raw), "utf-8")
    for name, given in (services or {}).items():
        builtins = msgspec.to_builtins(given)
        paths.service_config(config_dir, name).write_text(tomli_w.dumps(builtins), "utf-8")
    return config_dir


@asynccontextmanager
async def tmp_node(root: Path, platform: str = "uav1", **settings: Any) -> AsyncIterator[Node]:
    """Attach this process to a node in a temporary folder; several such nodes may exist at once."""
    node = Node.attach(await asyncio.to_thread(make_node, root, platform, **settings))
    try:
        yield node
    finally:
        node.close()
