"""Membership of the swarm: identities, the signed roster, the group key and its seals."""
