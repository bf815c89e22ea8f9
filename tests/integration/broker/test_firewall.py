"""The firewall rules of the page of trust, loaded without a change."""

import textwrap
from pathlib import Path

import pytest
from tests.integration.broker.namespace import ROOT, figures_of


def rules() -> str:
    """The block of the page that is a table of nft."""
    text = (ROOT / "share" / "doc" / "explanation" / "trust.md").read_text()
    begin, end = text.index("    table inet swarm {"), "\n    }\n"
    return textwrap.dedent(text[begin : text.index(end, begin) + len(end)])


@pytest.mark.root
def test_rules_of_page_bound_connections_of_each_address(tmp_path: Path) -> None:
    file = tmp_path / "swarm.nft"
    file.write_text(rules())
    seen = figures_of("crowd.py", str(file), tools=("ip", "nft"))
    assert seen == {"crowd": 32, "other": 5}
