"""Files of one node of a lab: its services, their settings, its keys, the folders for the rest."""

import shutil
from pathlib import Path
from typing import Any, Final

import tomli_w

from swarmctl.session.labs import LabNode, LabState
from swarmlab.provision.database import address_for_nodes
from swarmware.model import paths
from swarmware.model.names import Address
from swarmware.model.platform_kind import PlatformKind

STATION: Final = ("broker", "tree", "register", "timesync", "health", "guard", "mission", "logger", "hal")
"""A ground station has neither simulation nor control nor navigator."""
VEHICLE: Final = (*STATION, "sim", "control", "navigator")
BASIS: Final = ("broker", "tree", "register", "timesync", "health", "guard", "logger")
"""Services of each computer of a vehicle that has several."""
OF_UNIT: Final = {
    "main": (*BASIS, "mission"),
    "nav": (*BASIS, "estimator"),
    "fc": (*BASIS, "hal", "sim", "control", "guidance"),
}
"""Services of the computers of a vehicle: mission; estimator; controller, devices and motors.

`estimator` and `guidance` are the halves of `navigator`.
"""
RADIUS_M: Final = {"ugv": 0.35, "usv": 0.45, "uav": 0.3}
"""Radius of the sphere around a vehicle: configured in the simulation, used by the report."""
AIRFIELD: Final = "airfield"
"""World of a lab with an aircraft, which cannot stop and needs much space."""
LIDAR: Final = "ugv1"
"""Vehicle with a lidar, which replays the packets of a real one."""
TEMPLATES: Final = {"gcs": "gcs", "ugv": "ugv", "usv": "usv", "uav": "multirotor"}


def write_node(lab: LabState, node: LabNode, keys: Path) -> None:
    """Writes the files of a node; `keys`: folder with the keys of all platforms."""
    for directory in (node.config_dir / "services", node.run_dir, node.data_dir):
        directory.mkdir(mode=0o700, parents=True)
    # shared memory of a killed lab with the same name would be read as this one's
    shutil.rmtree(node.shm_dir, ignore_errors=True)
    Path(node.shm_dir).mkdir(mode=0o700)
    address = Address.parse(node.platform)
    shutil.copytree(keys / address.platform, node.keys_dir)
    _toml(
        node.config_dir / "node.toml",
        {
            "platform": address.platform,
            "unit": address.unit,
            "kind": node.kind,
            "template": TEMPLATES[node.kind],
            "services": list(_names(lab, node)),
            "processes": node.processes,
            "run_dir": str(node.run_dir),
            "shm_dir": node.shm_dir,
            "data_dir": str(node.data_dir),
            "keys_dir": str(node.keys_dir),
            "clock": {"offset_s": node.offset_s, "drift_ppm": node.drift_ppm},
        }
        | ({"airframe": airframe} if (airframe := lab.airframes.get(address.platform)) else {}),
    )
    for name, settings in _services(lab, node).items():
        _toml(paths.service_config(node.config_dir, name), settings)


def services(lab: LabState) -> list[str]:
    """Names of all services that nodes of the lab have."""
    return list(dict.fromkeys(name for node in lab.nodes for name in _names(lab, node)))


def _names(lab: LabState, node: LabNode) -> tuple[str, ...]:
    """Names of the services of a node."""
    return (*_usual_names(lab, node), *lab.services)


def _usual_names(lab: LabState, node: LabNode) -> tuple[str, ...]:
    if node.kind == PlatformKind.GCS:
        return STATION
    address = Address.parse(node.platform)
    several = any(
        Address.parse(other.platform).platform == address.platform for other in lab.nodes if other != node
    )
    return OF_UNIT[address.unit] if several else VEHICLE


def _services(lab: LabState, node: LabNode) -> dict[str, dict[str, Any]]:
    settings: dict[str, dict[str, Any]] = {
        "broker": {
            "multicast_group": lab.multicast_group,
            "multicast_interface": node.address,
            "bind_address": node.address,
            "udp_port": lab.udp_port,
        },
    }
    if lab.unit_delay_ms:
        settings["broker"]["unit_delay_ms"] = list(lab.unit_delay_ms)
    if node.kind != PlatformKind.GCS:
        settings["sim"] = {
            "world": lab.world or lab.experiment,
            "seed": lab.seed,
            "ground": {"radius_m": RADIUS_M["ugv"]},
            "surface": {"radius_m": RADIUS_M["usv"]},
            "multirotor": {"radius_m": RADIUS_M["uav"]},
        }
        if lab.world:
            settings["navigator"] = {"world": lab.world}
    if node.platform == LIDAR:
        settings["hal"] = {"drivers": ["sim", "system", "replay"]}
    if lab.mongodb_uri:
        settings["logger"] = {
            "mongodb_uri": address_for_nodes(lab.mongodb_uri, Path(lab.folder))
            if node.namespace
            else lab.mongodb_uri,
            "mongodb_database": lab.mongodb_database,
        }
    return settings


def _toml(path: Path, data: dict[str, Any]) -> None:
    path.touch(mode=0o600)  # the address of the database may have a password in it
    path.write_text(tomli_w.dumps(data), "utf-8")
