"""Addresses and ports of an invitation: what an operator types, and what this computer has."""

from contextlib import closing

import pytest

from swarmctl.membership.addresses import host_and_port, reachable
from swarmctl.membership.inviting import InvitationPlan, check_plan
from swarmctl.membership.listener import listening_socket
from swarmware.errors import Conflict, InvalidInput


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("base", ("base", 0)),
        ("base:7000", ("base", 7000)),
        ("10.0.0.1:1", ("10.0.0.1", 1)),
        ("fd00::1", ("fd00::1", 0)),
        ("[fd00::1]:7", ("fd00::1", 7)),
    ],
)
def test_address_has_host_and_may_have_port(text: str, found: tuple[str, int]) -> None:
    assert host_and_port(text) == found


@pytest.mark.parametrize("text", ["", ":7", "base:", "base:x", "base:70000", "base:0"])
def test_an_address_of_another_form_is_refused(text: str) -> None:
    with pytest.raises(InvalidInput):
        host_and_port(text)


@pytest.mark.parametrize(
    ("addresses", "found"),
    [
        ({"lo": ["127.0.0.1", "::1"]}, ("127.0.0.1",)),
        ({"lo": ["127.0.0.1"], "eth0": ["10.0.0.1", "fe80::1%eth0"]}, ("10.0.0.1",)),
        ({"eth0": ["fd00::1", "fe80::1%eth0"]}, ("fd00::1",)),
        ({"docker0": ["172.17.0.1"], "wlan0": ["10.0.0.2"]}, ("10.0.0.2",)),
        ({f"eth{n}": [f"10.0.{n}.1"] for n in range(9)}, ("10.0.0.1", "10.0.1.1", "10.0.2.1", "10.0.3.1")),
    ],
)
def test_addresses_that_others_can_use_are_in_token(
    addresses: dict[str, list[str]], found: tuple[str, ...]
) -> None:
    assert reachable(addresses) == found


def test_two_inviters_on_one_computer_take_port_each() -> None:
    with closing(listening_socket(0)) as one, closing(listening_socket(0)) as other:
        assert one.getsockname()[1] != other.getsockname()[1]
        with pytest.raises(Conflict, match="is in use"):
            listening_socket(one.getsockname()[1])


@pytest.mark.parametrize(
    ("wanted", "text"),
    [
        (InvitationPlan(("uav1", "uav1"), "node", 60.0), "named twice"),
        (InvitationPlan(("UAV1",), "node", 60.0), "UAV1"),
        (InvitationPlan(("uav1",), "king", 60.0), "king"),
        (InvitationPlan(("uav1",), "node", 1e9), "--valid"),
        (InvitationPlan(("uav1",), "node", 0.0), "--valid"),
        (InvitationPlan(("uav1", "uav2"), "node", 60.0, "", "x"), "--file: 2 platforms"),
    ],
)
def test_an_invitation_that_cannot_be_made_is_refused(wanted: InvitationPlan, text: str) -> None:
    with pytest.raises(InvalidInput, match=text):
        check_plan(wanted)
