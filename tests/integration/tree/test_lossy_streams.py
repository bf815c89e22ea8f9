"""Streams between nodes over lossy and over slow links: whole and in order, or both ends know."""

import pytest
from tests.integration.broker.namespace import figures_of

PROGRAM = "../tree/lossystream.py"


@pytest.mark.root
def test_a_stream_of_a_scanner_arrives_whole_and_in_order_over_a_lossy_link() -> None:
    seen = figures_of(PROGRAM, "300", "5", "--loss", "30", tools=("ip", "nft"))
    assert seen["received"] == seen["written"]
    assert seen["in_order"]
    assert seen["reader_lost"] == seen["writer_lost"] == 0
    assert seen["p50_ms"] < 2000


@pytest.mark.root
def test_what_a_slow_link_cannot_carry_is_a_gap_that_writer_and_reader_both_see() -> None:
    seen = figures_of(PROGRAM, "753", "5", "--link", "1mbit", tools=("ip", "tc"))
    assert seen["in_order"]
    assert seen["reader_lost"] > 0
    assert seen["reader_lost"] == seen["writer_lost"]
    assert seen["received"] + seen["reader_lost"] <= seen["written"]
    assert seen["received"] > 300, "the link is used for new items"
