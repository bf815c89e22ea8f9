"""A vehicle of a lab on three computers: each has its services, and all have the keys of the platform."""

import tempfile
import tomllib
from pathlib import Path

import pytest

from swarmlab.provision import provisioning
from swarmlab.provision.node_files import BASIS, VEHICLE
from swarmlab.provision.provisioning import LabSpec
from swarmware.errors import ConfigError
from swarmware.model import document
from swarmware.model.config import NodeConfig, load_node


def test_services_of_distributed_vehicle_are_each_once(
    monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    folder = tempfile.TemporaryDirectory()  # a socket's path has 107 bytes
    request.addfinalizer(folder.cleanup)
    monkeypatch.setenv("SWARMCTL_LABS", folder.name)
    spec = LabSpec(
        experiment="formation", nodes=3, seed=1, name="units", units="uav1", unit_delay_ms=(2.0, 8.0)
    )
    lab = provisioning.make(spec)
    try:
        nodes: dict[str, NodeConfig] = {node.platform: load_node(node.config_dir) for node in lab.nodes}
        assert list(nodes) == ["gcs", "ugv1", "uav1", "uav1.nav", "uav1.fc"]
        units = [nodes[name] for name in ("uav1", "uav1.nav", "uav1.fc")]
        assert [(node.platform, node.unit) for node in units] == [
            ("uav1", "main"),
            ("uav1", "nav"),
            ("uav1", "fc"),
        ]
        halves = {"estimator", "guidance"}
        assert {name for node in units for name in node.services} == {*VEHICLE, *halves} - {"navigator"}
        own = [set(node.services) - set(BASIS) for node in units]
        assert sum(map(len, own)) == len(set().union(*own))
        assert nodes["ugv1"].services == VEHICLE
        identities = {(Path(node.keys_dir) / "node.key").read_bytes() for node in units}
        assert len(identities) == 1
        broker = document.read(lab.node("uav1.fc").config_dir / "services" / "broker.toml")
        assert "unit_delay_ms = [" in broker
    finally:
        provisioning.remove(lab)


def test_airframe_follows_vehicle_and_aircraft_world(
    monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    folder = tempfile.TemporaryDirectory()
    request.addfinalizer(folder.cleanup)
    monkeypatch.setenv("SWARMCTL_LABS", folder.name)

    def world(services: Path, name: str) -> str:
        path = services / name
        return str(tomllib.loads(path.read_text()).get("world", "")) if path.exists() else ""

    def made(*airframe: str) -> dict[str, tuple[str, str, str]]:
        """Airframe of each vehicle, and the worlds of its simulation and of its navigator."""
        lab = provisioning.make(LabSpec(experiment="formation", nodes=4, seed=1, airframe=airframe))
        try:
            return {
                node.platform: (
                    load_node(node.config_dir).airframe,
                    world(node.config_dir / "services", "sim.toml"),
                    world(node.config_dir / "services", "navigator.toml"),
                )
                for node in lab.nodes
                if node.platform != "gcs"
            }
        finally:
            provisioning.remove(lab)

    plain = ("", "formation", "")
    assert made("uav1=helicopter") == {
        "ugv1": plain,
        "uav1": ("helicopter", "formation", ""),
        "uav2": plain,
    }
    field = ("airfield", "airfield")
    everywhere = made("uav1=quad_1k5", "uav2=fixed_wing")
    assert everywhere == {"ugv1": ("", *field), "uav1": ("quad_1k5", *field), "uav2": ("fixed_wing", *field)}
    with pytest.raises(ConfigError, match="no airframe 'zeppelin'; expected one of"):
        provisioning.make(LabSpec(experiment="formation", nodes=4, seed=1, airframe=("zeppelin",)))
