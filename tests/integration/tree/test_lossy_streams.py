"""Streams between nodes over lossy and over slow links: whole and in order, or both ends know."""

import pytest
from tests.integration.broker.namespace import figures_of

PROGRAM = "../tree/lossystream.py"


@pytest.mark.root
def test_scanner_stream_arrives_whole_over_lossy_link() -> None:
    seen = figures_of(PROGRAM, "300", "5", "--loss", "30", tools=("ip", "nft"))
    assert seen["received"] == seen["written"]
    assert seen["in_order"]
    assert seen["reader_lost"] == seen["writer_lost"] == 0
    assert seen["p50_ms"] < 2000


@pytest.mark.root
def test_overloaded_stream_has_gap_at_writer_and_reader() -> None:
    seen = figures_of(PROGRAM, "753", "5", "--link", "1mbit", tools=("ip", "tc"))
    assert seen["in_order"]
    assert seen["reader_lost"] > 0
    assert seen["reader_lost"] == seen["writer_lost"]
    assert seen["received"] + seen["reader_lost"] == seen["written"]
    assert seen["received"] > 300, "the link is used for new items"
