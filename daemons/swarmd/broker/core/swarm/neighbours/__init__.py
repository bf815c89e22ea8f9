"""Neighbours of this node: state, loss, cost and deadline of the link to each, and its addresses."""
