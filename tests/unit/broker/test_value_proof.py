"""Proofs of the values of a beacon: any of them, from any node, lead to what its sender signed."""

from itertools import combinations
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmd.broker.core.beacon import beacon_codec as codec
from swarmd.broker.core.beacon.beacon import Beacon, RelayedValue, RouteRow
from swarmd.broker.core.beacon.parts.value_proof import (
    HASH_BYTES,
    SIGNATURE_BYTES,
    ValueProof,
    prove,
    restore,
    value_hash,
)
from swarmd.broker.core.beacon.proof_parts import proofs_bytes
from swarmware.errors import WireError

HW: Final = 9
SESSION: Final = 77
BODY: Final = bytes(range(HASH_BYTES))
SIGNATURE: Final = bytes(SIGNATURE_BYTES)
ONE_BYTES: Final = 91
"""Of the proof of one value, the only one of its beacon; 3 more for the part."""


def relays(count: int, stamp_us: int = 5) -> tuple[RelayedValue, ...]:
    """All values of a beacon, with its proof."""
    bare = [RelayedValue(HW, number, stamp_us, 100, 2, True, b"pose") for number in range(count)]
    proof = prove(SESSION, BODY, [leaf_of(relay) for relay in bare], SIGNATURE)
    return tuple(
        RelayedValue(HW, number, stamp_us, 100, 2, True, b"pose", proof, number) for number in range(count)
    )


def leaf_of(relay: RelayedValue) -> bytes:
    return value_hash(relay.data_id, relay.stamp_us, relay.packed, relay.payload)


def proof_of(relay: RelayedValue) -> ValueProof:
    assert relay.proof is not None
    return relay.proof


def sent(*values: RelayedValue) -> tuple[RelayedValue, ...]:
    """Relayed values after a way through the air."""
    return codec.decode(codec.encode(Beacon(rows=(RouteRow(1, 2, 3),), relays=values))).relays


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
def test_any_chosen_values_prove_over_two_relays(count: int) -> None:
    everything = relays(count)
    signed = proof_of(everything[0]).signed_content(HW)
    for size in range(1, count + 1):
        for chosen in combinations(everything, size):
            first = sent(*chosen)
            assert [proof_of(relay).signed_content(HW) for relay in first] == [signed] * size
            assert [(relay.data_id, relay.position) for relay in first] == [
                (relay.data_id, relay.position) for relay in chosen
            ]
            [last] = sent(first[-1])
            assert proof_of(last).signed_content(HW) == signed


@pytest.mark.parametrize(
    ("values", "chosen", "hashes"), [(1, 1, 0), (5, 5, 0), (5, 1, 2), (32, 1, 5), (32, 2, 4), (255, 1, 7)]
)
def test_size_of_proof_grows_with_logarithm_of_values(values: int, chosen: int, hashes: int) -> None:
    some = relays(values)[-chosen:]
    bare = tuple(RelayedValue(HW, each.data_id, 5, 100, 2, True, b"pose") for each in some)
    size = len(codec.encode(Beacon(relays=some))) - len(codec.encode(Beacon(relays=bare)))
    assert size == proofs_bytes(some) == 3 + ONE_BYTES - 1 + chosen + hashes * HASH_BYTES
    assert proofs_bytes(bare) == 0


@pytest.mark.parametrize(
    "other",
    [
        RelayedValue(HW, 2, 5, 100, 2, True, b"POSE"),
        RelayedValue(HW, 2, 6, 100, 2, True, b"pose"),
        RelayedValue(HW, 9, 5, 100, 2, True, b"pose"),
        RelayedValue(HW, 2, 5, 100, 2, False, b"pose"),
    ],
    ids=["payload", "stamp", "board", "form"],
)
def test_another_value_leads_to_something_else(other: RelayedValue) -> None:
    true = proof_of(relays(5)[2])
    further = b"".join(true.further([2]))
    found, used = restore(SESSION, BODY, 5, {2: leaf_of(other)}, further, SIGNATURE)
    assert used == len(further)
    assert found.signed_content(HW) != true.signed_content(HW)


def test_signature_names_sender_session_and_beacon() -> None:
    [relay] = relays(1)
    true = proof_of(relay)
    others = [
        true.signed_content(HW + 1),
        prove(SESSION + 1, BODY, [leaf_of(relay)], SIGNATURE).signed_content(HW),
        prove(SESSION, bytes(HASH_BYTES), [leaf_of(relay)], SIGNATURE).signed_content(HW),
        prove(SESSION, BODY, [], SIGNATURE).signed_content(HW),
    ]
    assert true.signed_content(HW) not in others
    assert len(set(others)) == len(others)


def test_values_with_and_without_proof_travel_together() -> None:
    first, second = relays(3)[:2], relays(2, stamp_us=9)[:1]
    bare = RelayedValue(HW, 7, 5, 100, 2, True, b"pose")
    arrived = sent(*first, *second, bare)
    assert [relay.proof is None for relay in arrived] == [False, False, False, True]
    assert arrived[0].proof is arrived[1].proof
    assert proof_of(arrived[2]).signed_content(HW) == proof_of(second[0]).signed_content(HW)


def test_two_values_for_one_position_are_refused() -> None:
    true, other = relays(2)
    false = RelayedValue(HW, 1, 5, 100, 2, True, b"false", true.proof, true.position)
    with pytest.raises(WireError, match="names 1 positions"):
        sent(false, true)
    assert sent(true, other)


@pytest.mark.parametrize(
    ("count", "positions", "further"), [(2, [2], 1), (0, [0], 0), (3, [0], 1), (1, [], 0)]
)
def test_mismatched_positions_and_hashes_are_refused(count: int, positions: list[int], further: int) -> None:
    leaves = {position: bytes(HASH_BYTES) for position in positions}
    with pytest.raises(WireError, match="proof of"):
        restore(SESSION, BODY, count, leaves, bytes(HASH_BYTES * further), SIGNATURE)


@given(st.binary(max_size=300))
def test_any_bytes_as_proofs_are_decoded_or_refused(part: bytes) -> None:
    body = codec.encode(Beacon(relays=(RelayedValue(HW, 1, 5, 100, 2, True, b"pose"),)))
    try:
        codec.decode(codec.append_statement(body, b"\x0a" + len(part).to_bytes(2, "little") + part))
    except WireError:
        return


@pytest.mark.parametrize("keep", range(0, 110, 7))
def test_a_proof_that_is_cut_short_is_refused(keep: int) -> None:
    everything = relays(4)
    body = codec.encode(Beacon(relays=everything[:1]))
    bare = codec.encode(Beacon(relays=(RelayedValue(HW, 0, 5, 100, 2, True, b"pose"),)))
    part = body[len(bare) + 3 :][:keep]
    short = codec.append_statement(bare, b"\x0a" + len(part).to_bytes(2, "little") + part)
    if not part:
        assert codec.decode(short).relays[0].proof is None
        return
    with pytest.raises(WireError):
        codec.decode(short)
