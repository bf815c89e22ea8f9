"""The commands of `keys`: the swarm's root, invitations, joining, and changes of the roster."""
