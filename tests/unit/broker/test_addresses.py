"""Addresses of the broker's configuration: IPv4 alone, and whether this computer has them."""

import socket
from pathlib import Path

import pytest

from swarmd.broker.config import Config, NetworkMedium
from swarmd.broker.sockets.pinned_addresses import PinnedAddresses
from swarmware.errors import ConfigError
from swarmware.model.config import load_service


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('bind_address = "::"', "bind_address '::': IPv4 only"),
        ('bind_address = "fd00::1"', "bind_address 'fd00::1': IPv4 only"),
        ('multicast_interface = "fe80::1"', "multicast_interface 'fe80::1': IPv4 only"),
        ('multicast_group = "ff02::4242"', "multicast_group 'ff02::4242': IPv4 only"),
        ('multicast_group = "192.168.1.5"', "expected an IPv4 group, 224.0.0.0 to 239.255.255.255"),
        ('multicast_group = "239.83.87"', "expected an IPv4 group"),
        ('metrics_address = "::1"', "metrics_address '::1': IPv4 only"),
        ('seeds = ["[fd00::1]:7447"]', "seed '[fd00::1]:7447': IPv4 only"),
        ('seeds = ["fd00::1:7447"]', "seed 'fd00::1:7447': IPv4 only"),
        ('seeds = ["host"]', "seed 'host': expected host:port"),
        ('seeds = ["host:70000"]', "seed 'host:70000': expected host:port"),
        (
            '[[network]]\nname = "radio"\ninterface = "fd00::1"',
            "network radio: interface 'fd00::1': IPv4 only",
        ),
    ],
)
def test_address_outside_ipv4_is_refused_with_message(tmp_path: Path, line: str, message: str) -> None:
    (tmp_path / "services").mkdir()
    (tmp_path / "services/broker.toml").write_text(line)
    with pytest.raises(ConfigError) as refused:
        load_service(tmp_path, "broker", Config)
    assert message in str(refused.value)
    assert "broker.toml" in str(refused.value)


def test_seeds_are_host_and_port() -> None:
    assert Config(seeds=("gcs.local:7447", "10.0.0.1:1")).seeds == ("gcs.local:7447", "10.0.0.1:1")


def test_own_address_is_found_and_foreign_is_missing() -> None:
    assert PinnedAddresses(Config(bind_address="127.0.0.1", multicast_interface="lo")).missing() == ""
    assert PinnedAddresses(Config()).missing() == ""
    gone = PinnedAddresses(
        Config(bind_address="192.0.2.7", network=(NetworkMedium(name="radio", interface="wlan97"),))
    ).missing()
    assert gone == (
        "bind_address 192.0.2.7: this computer does not have it now; "
        "network radio: interface wlan97: this computer does not have it now"
    )


def test_departing_address_is_named_with_its_interface(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pinned = PinnedAddresses(Config(bind_address="127.0.0.1"))

    class Gone(socket.socket):
        def bind(self, address: object) -> None:
            raise OSError(99, "Cannot assign requested address")

    monkeypatch.setattr(socket, "socket", Gone)
    name = next(name for _, name in socket.if_nameindex() if name.startswith("lo"))
    assert pinned.missing() == (
        f"bind_address 127.0.0.1, which interface {name} had at the start: this computer does not have it now"
    )
