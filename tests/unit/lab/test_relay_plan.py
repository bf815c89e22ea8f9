"""Addresses, packets and settings of a lab on a relay, without a process."""

import resource
import tomllib
from itertools import permutations
from pathlib import Path

import pytest

from swarmctl.session import labs
from swarmlab.provision import provisioning
from swarmlab.provision.provisioning import LabSpec
from swarmlab.radio import relay_plan
from swarmlab.radio.core.relay_packet import TCP_HEADERS, UDP_HEADERS, PacketKind, RelayPacket
from swarmlab.radio.relay_plan import NODES_MAX, RelayPlan
from swarmlab.run import running
from swarmware.errors import InvalidInput

SPEC = LabSpec(experiment="formation", nodes=3, seed=1, net="relay")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SWARMCTL_LABS", str(tmp_path / "labs"))
    return labs.labs_folder()


@pytest.mark.parametrize("kind", list(PacketKind))
def test_a_packet_is_the_same_after_its_frame_which_has_the_length_of_real_headers(kind: PacketKind) -> None:
    packet = RelayPacket(kind, 7, b"text", 300, 4_000_000, 12)
    frame = packet.frame(b"\x02SW\x00\x00\x01")
    assert RelayPacket.of(frame) == packet
    is_tcp = kind in {PacketKind.SEGMENT, PacketKind.ACKNOWLEDGEMENT}
    assert len(frame) == (TCP_HEADERS if is_tcp else UDP_HEADERS) + 4
    assert frame[:6] == b"\x02SW\x00\x00\x01"


def test_no_two_nodes_groups_and_views_have_the_same_address() -> None:
    plan = RelayPlan("239.255.7.9", 25_000)
    every = range(NODES_MAX)
    assert len({plan.node(one) for one in every} | {plan.group_of(one) for one in every}) == 2 * NODES_MAX
    some = range(0, NODES_MAX, 10)
    seen = {plan.seen(other, at) for at, other in permutations(some, 2)}
    assert len(seen) == len(some) * (len(some) - 1)
    assert plan.group_of(0) == "239.255.7.1"


def test_each_node_has_an_address_and_a_group_of_its_own_and_the_ports_of_all() -> None:
    lab = provisioning.make(SPEC)
    try:
        brokers = [
            tomllib.loads((node.config_dir / "services/broker.toml").read_text()) for node in lab.nodes
        ]
        assert [one["bind_address"] for one in brokers] == ["127.83.0.1", "127.83.0.2", "127.83.0.3"]
        assert len({one["multicast_group"] for one in brokers}) == 3
        (ports,) = {(one["udp_port"], one["unicast_port"], one["tcp_port"]) for one in brokers}
        assert ports == (lab.udp_port, lab.udp_port, lab.udp_port + 1)
        assert running.command(lab.nodes[0])[0].endswith("python"), "no namespace is entered"
        assert Path(lab.radio_file).name == "s3.toml"
    finally:
        provisioning.remove(lab)


def test_a_lab_with_more_nodes_than_open_files_allow_is_refused_with_the_number(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (64, 100))
    with pytest.raises(InvalidInput, match="3 nodes need 106 open files, the limit of this user is 100"):
        provisioning.make(SPEC)
    assert list(folder.iterdir()) == []


def test_the_limit_of_open_files_is_raised_when_it_may_be(monkeypatch: pytest.MonkeyPatch) -> None:
    limits: list[tuple[int, int]] = []
    monkeypatch.setattr(resource, "getrlimit", lambda _: (64, 5000))
    monkeypatch.setattr(resource, "setrlimit", lambda _, new: limits.append(new))
    relay_plan.reserve_descriptors(16)
    assert limits == [(1744, 5000)]


def test_more_nodes_than_addresses_are_refused() -> None:
    with pytest.raises(InvalidInput, match="expected 250 at most"):
        relay_plan.reserve_descriptors(NODES_MAX + 1)
