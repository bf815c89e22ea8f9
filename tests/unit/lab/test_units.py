"""A vehicle of a lab on three computers: each has its services, and all have the keys of the platform."""

import tempfile
from pathlib import Path

import pytest

from swarmlab.provision import provisioning
from swarmlab.provision.provisioning import VEHICLE, LabSpec
from swarmware.model import document
from swarmware.model.config import NodeConfig, load_node


def test_the_services_of_a_distributed_vehicle_are_those_of_a_whole_one_each_on_one_computer(
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
        own = [set(node.services) - set(provisioning.BASIS) for node in units]
        assert sum(map(len, own)) == len(set().union(*own))
        assert nodes["ugv1"].services == VEHICLE
        identities = {(Path(node.keys_dir) / "node.key").read_bytes() for node in units}
        assert len(identities) == 1
        broker = document.read(lab.node("uav1.fc").config_dir / "services" / "broker.toml")
        assert "unit_delay_ms = [" in broker
    finally:
        provisioning.remove(lab)
