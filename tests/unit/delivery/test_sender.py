"""Who sent a frame and when it came, in the extension of its header: only the own broker states it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import WireError
from swarmware.model.access import Role, Sender
from swarmware.transport.delivery.answer import with_lifetime
from swarmware.transport.delivery.sender import (
    Caller,
    caller_of,
    sender_and_arrival_ns,
    sender_of,
    with_caller,
    with_sender,
)

FAR = Sender("uav7", Role.NODE)
OTHER = b"\x77\x03abc"


@pytest.mark.parametrize("sender", [None, FAR, Sender("gcs", Role.OPERATOR), Sender("a" * 32, Role.NODE)])
@pytest.mark.parametrize("arrived_ns", [None, 0, 4_000, 2**62])
@pytest.mark.parametrize("before", [b"", OTHER, with_lifetime(2.0), with_lifetime(2.0) + OTHER])
def test_stated_elements_are_read_and_others_stay(
    sender: Sender | None, arrived_ns: int | None, before: bytes
) -> None:
    extension = with_sender(before, sender, arrived_ns)
    assert sender_and_arrival_ns(extension) == (sender, arrived_ns)
    assert extension.startswith(before)


def test_what_a_frame_stated_before_is_taken_out() -> None:
    false = with_sender(OTHER, Sender("gcs", Role.OPERATOR), 1)
    extension = with_sender(false, FAR, 2)
    assert sender_and_arrival_ns(extension) == (FAR, 2)
    assert b"gcs" not in extension
    assert with_sender(extension, None) == OTHER


@pytest.mark.parametrize(
    ("extension", "message"),
    [(b"\x77", "an element ends behind it"), (b"\x77\x05ab", "ends behind it"), (OTHER * 50, "no room")],
)
def test_an_extension_that_cannot_take_it_is_refused(extension: bytes, message: str) -> None:
    with pytest.raises(WireError, match=message):
        with_sender(extension, FAR, 5)


@given(st.binary(max_size=255))
def test_any_extension_has_a_sender_or_none(extension: bytes) -> None:
    found, came_ns = sender_and_arrival_ns(extension)
    assert found is None or isinstance(found.role, Role)
    assert came_ns is None or isinstance(came_ns, int)
    try:
        stated = with_sender(extension, FAR, 7)
    except WireError:
        return
    assert sender_and_arrival_ns(stated) == (FAR, 7)


@pytest.mark.parametrize("via", [(), ("uav2",), ("uav2", "uav3")])
def test_user_and_path_are_read_as_stated(via: tuple[str, ...]) -> None:
    sender = Sender("gcs", Role.OPERATOR, "anna", via)
    extension = with_sender(OTHER, sender, 5)
    assert sender_of(extension) == sender
    assert str(sender) == "anna@gcs"
    assert with_sender(extension, None) == OTHER


def test_full_path_keeps_its_last_platforms() -> None:
    via = tuple(f"platform_with_a_long_name_{number}" for number in range(20))
    extension = with_sender(OTHER, Sender("gcs", Role.OPERATOR, "anna", via), 5)
    stated = sender_of(extension)
    assert stated is not None
    assert stated.via[-2:] == via[-2:]


def test_caller_of_another_process_replaces_its_statements() -> None:
    false = with_sender(with_caller(OTHER, Caller("root", Role.MAINTAINER)), FAR, 5)
    stated = with_caller(false, Caller("bob", Role.OBSERVER))
    assert caller_of(stated) == Caller("bob", Role.OBSERVER)
    assert sender_of(stated) is None
    assert caller_of(with_caller(stated, None)) is None


@given(st.binary(max_size=255))
def test_any_extension_has_a_caller_or_none(extension: bytes) -> None:
    found = caller_of(extension)
    assert found is None or found.name.isprintable()
    named = sender_of(extension)
    assert named is None or (named.caller + "".join(named.via)).isprintable()
