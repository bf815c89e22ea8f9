"""Names of the senders of requests, for records and for checks."""

from types import SimpleNamespace
from typing import cast

import pytest

from swarmware.model.access import Role, Sender
from swarmware.module.meta import Meta
from swarmware.module.module import Module

HERE, THERE, UNKNOWN = 1, 2, 0xAB
MEMBER = Sender("gcs", Role.OPERATOR)


def module() -> Module:
    applications = {7: SimpleNamespace(id="swarmctl#1")}
    clocks = {THERE: SimpleNamespace(platform="uav2")}
    return cast("Module", SimpleNamespace(
        platform="uav1",
        node=SimpleNamespace(
            hardware=HERE, applications=SimpleNamespace(table=SimpleNamespace(application=applications.get))
        ),
        remote_clocks=SimpleNamespace(conversion=clocks.get),
    ))  # fmt: skip


@pytest.mark.parametrize(
    ("meta", "name", "platform"),
    [
        (Meta(THERE, 7, 1, 1, MEMBER), str(MEMBER), "gcs"),
        (Meta(HERE, 7, 1, 1), "swarmctl#1@uav1", "uav1"),
        (Meta(HERE, 8, 1, 1), "?@uav1", "uav1"),
        (Meta(THERE, 7, 1, 1), "?@uav2", None),
        (Meta(UNKNOWN, 7, 1, 1), "?@000000ab", None),
    ],
)
def test_sender_has_known_name_and_certain_platform(meta: Meta, name: str, platform: str | None) -> None:
    assert Module.requester(module(), meta) == name
    assert Module.requesting_platform(module(), meta) == platform
