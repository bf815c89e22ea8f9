"""What a frame carries that others forward: its path, and a signature of all that they must not change."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmware.errors import WireError
from swarmware.model.frame import EXTENSION_LIMIT, Codec, Frame, FrameKind, decode, encode
from swarmware.transport.delivery import signature
from swarmware.transport.delivery.answer import lifetime_ns, with_lifetime
from swarmware.transport.sodium import SigningKey, verify

KEY = SigningKey(bytes(range(32)))
FRAME = Frame(
    FrameKind.MESSAGE, 5, 6, 7, 8, 9, 10, 11, 12, 13, 2, extension=with_lifetime(2.0), payload=b"\x91\x01"
)


def signed(frame: Frame = FRAME, signer_hw: int = 6, session: int = 77) -> Frame:
    extension = signature.signed_extension(frame, signer_hw, session, KEY.sign)
    return msgspec.structs.replace(frame, extension=extension)


def is_genuine(frame: Frame) -> bool:
    parts = signature.split(frame.extension)
    assert parts.signature is not None
    return verify(KEY.public, parts.signature.value, signature.signed_content(frame, parts))


def test_signature_holds_while_hops_and_path_change() -> None:
    frame = decode(encode(signed()))
    for hops, node in ((23, 100), (22, 200), (21, 300)):
        frame.hops_left = hops
        frame.extension = signature.with_node(frame.extension, node)
        frame = decode(encode(frame))
    parts = signature.split(frame.extension)
    assert is_genuine(frame)
    assert parts.path == (100, 200, 300)
    assert parts.signature is not None
    assert (parts.signature.signer_hw, parts.signature.session) == (6, 77)
    assert parts.extension == FRAME.extension
    assert lifetime_ns(frame.extension) == 2_000_000_000


@pytest.mark.parametrize(
    "change",
    [
        {"kind": FrameKind.REQUEST},
        {"data_id": 1},
        {"sender_hw": 1},
        {"sender_app": 1},
        {"receiver_hw": 1},
        {"receiver_app": 1},
        {"sequence": 1},
        {"stamp_ns": 1},
        {"echo_tx_us": 1},
        {"echo_rx_us": 1},
        {"flags": 4},
        {"codec": Codec.ZLIB},
        {"payload": b"\x91\x02"},
    ],
    ids=lambda change: next(iter(change)),
)
def test_any_other_change_breaks_it(change: dict[str, object]) -> None:
    assert not is_genuine(msgspec.structs.replace(signed(), **change))


def test_changed_lifetime_or_added_element_breaks_it() -> None:
    frame = signed()
    longer = frame.extension.replace(with_lifetime(2.0), with_lifetime(3600.0))
    assert not is_genuine(msgspec.structs.replace(frame, extension=longer))
    assert not is_genuine(msgspec.structs.replace(frame, extension=b"\x77\x01x" + frame.extension))


def test_a_signature_of_another_session_is_another_one() -> None:
    one, other = signed(session=1).extension, signed(session=2).extension
    assert is_genuine(signed(session=1))
    mixed = one[:-64] + other[-64:]
    assert not is_genuine(msgspec.structs.replace(FRAME, extension=mixed))


def test_second_signature_replaces_first_with_its_path() -> None:
    once = signed()
    once.extension = signature.with_node(once.extension, 4)
    assert signed(once).extension == signed().extension


def test_full_path_is_kept_and_signature_refused() -> None:
    full = b"\x77" + bytes((EXTENSION_LIMIT - 4,)) + bytes(EXTENSION_LIMIT - 4)
    assert signature.with_node(full, 1) == full
    with pytest.raises(WireError, match="no room for a signature"):
        signed(msgspec.structs.replace(FRAME, extension=full))


@given(st.binary(max_size=EXTENSION_LIMIT), st.integers(0, 2**32 - 1))
def test_any_extension_is_split_or_refused(extension: bytes, node: int) -> None:
    longer = signature.with_node(extension, node)
    assert len(longer) <= EXTENSION_LIMIT
    try:
        parts = signature.split(extension)
    except WireError:
        return
    assert parts.extension in extension
    if longer != extension:
        assert signature.split(longer).path == (*parts.path, node)


@pytest.mark.parametrize("extension", [b"\x06\x05abcde", b"\x06\x08abcd", b"\x06\x01a", b"\x06\xff"])
def test_path_of_partial_nodes_is_refused(extension: bytes) -> None:
    with pytest.raises(WireError, match="its path has"):
        signature.split(extension)
