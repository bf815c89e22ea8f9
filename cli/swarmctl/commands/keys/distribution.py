"""A new roster on its way from the root to the node on this computer, and from there to the swarm."""

from swarmctl.commands.keys.node_keys import NodeKeys
from swarmctl.terminal.output import Output
from swarmware.errors import Denied, NotFound
from swarmware.transport.security.root import Root, fingerprint


def local_member(out: Output, root: Root) -> NodeKeys | None:
    """The node on this computer, if it is a member of the root's swarm; None without a node or without keys.

    Raises: Denied when it belongs to another swarm, or this user may not read its keys; ConfigError.
    """
    try:
        node = NodeKeys.find(out.settings)
    except NotFound:
        return None
    if not node.has_identity:
        return None
    found = node.load().root_public
    if found != root.public:
        raise Denied(
            f"{node.platform} belongs to the swarm of root {fingerprint(found)}, and this root is"
            f" {fingerprint(root.public)}; expected --root with that of its swarm, or --config of"
            " another node"
        )
    return node


def hand_over(out: Output, root: Root) -> None:
    """Gives the root's roster to the node on this computer, which gives it to the others.

    Raises: as `local_member`; OSError when the folder of keys cannot be written.
    """
    node = local_member(out, root)
    if node is None:
        out.warn(
            f"no node of the swarm is on this computer: roster {root.roster.version} stays with the root;"
            " expected a node here, which hands it on"
        )
        return
    node.take(root.signed)
    if node.runs:
        out.say(f"{node.platform} uses roster {root.roster.version} after a restart")
