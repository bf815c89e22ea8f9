"""Orders and the list of hosts, as a fleet test writes them."""

from pathlib import Path
from typing import Any

import msgspec

from swarmctl.commands.fleet.agent import HostAgent, HostOrder
from swarmctl.commands.fleet.plan import HostStatus
from swarmctl.membership import hosts
from swarmctl.membership.hosts import digest


def order(folder: Path, verb: Any, **more: Any) -> HostOrder:
    return HostOrder(verb, str(folder / "etc"), str(folder), "none", "swarm.target", **more)


def content(folder: Path, **services: bytes) -> dict[str, bytes]:
    node = f'platform = "uav1"\nrun_dir = "{folder}/run"\ndata_dir = "{folder}/data"\n'
    return {
        "config/node.toml": node.encode(),
        **{f"config/services/{name}.toml": data for name, data in services.items()},
    }


def push(folder: Path, files: dict[str, bytes]) -> HostStatus:
    sent = order(folder, "push", digest=digest(files))
    return HostAgent(sent).carry_out(msgspec.msgpack.encode(files))


def read(text: str, folder: Path = Path("/fleet")) -> list[hosts.FleetHost]:
    return hosts.parse_hosts(text, folder / "HOSTS.toml")


HOST = '[[hosts]]\nname = "uav1"\naddress = "a"\n'
