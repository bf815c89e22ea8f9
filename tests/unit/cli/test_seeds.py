"""Seeds in the file of a broker: one is added, and everything else of the file stays."""

from pathlib import Path

import pytest

from swarmctl.membership.node_keys import NodeKeys
from swarmctl.membership.seeds import add_seed, unicast_port
from swarmware.errors import ConfigError
from swarmware.model.config import load_node
from swarmware.testing.tmpnode import make_node

SEED = "10.0.0.1:7450"


@pytest.fixture
def node(tmp_path: Path) -> NodeKeys:
    folder = make_node(tmp_path, "uav1")
    return NodeKeys(folder, load_node(folder))


def file(node: NodeKeys) -> Path:
    return node.config_dir / "services/broker.toml"


def test_seed_is_entered_once_and_comments_stay(node: NodeKeys) -> None:
    shipped = (Path(__file__).parents[3] / "etc/swarm/services/broker.toml").read_text()
    file(node).write_text(shipped)
    assert add_seed(node, SEED)
    assert file(node).read_text() == shipped.replace("seeds = []", f'seeds = ["{SEED}"]')
    assert not add_seed(node, SEED)
    assert add_seed(node, "10.0.0.2:7450")
    assert f'seeds = ["{SEED}", "10.0.0.2:7450"]' in file(node).read_text()


@pytest.mark.parametrize("text", [None, "", "udp_port = 7555\n", "# no seeds\nunicast_port = 7450"])
def test_a_file_without_the_key_gets_it(node: NodeKeys, text: str | None) -> None:
    if text is not None:
        file(node).write_text(text)
    assert add_seed(node, SEED)
    assert file(node).read_text() == f'seeds = ["{SEED}"]\n{text or ""}'


@pytest.mark.parametrize(
    "text", ['seeds = [\n  "a:1",\n]\n', "seeds=['a:1']\n", "nonsense = 1\n", "unicast_port = "]
)
def test_unclear_file_stays_unchanged(node: NodeKeys, text: str) -> None:
    file(node).write_text(text)
    with pytest.raises(ConfigError, match="broker"):
        add_seed(node, SEED)
    assert file(node).read_text() == text


def test_only_a_fixed_port_is_one_for_others(node: NodeKeys) -> None:
    assert unicast_port(node) == 0
    file(node).write_text("unicast_port = 7450\n")
    assert unicast_port(node) == 7450
