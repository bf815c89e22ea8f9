"""Exchange with the trees of other nodes: messages in both directions, mirrors, and the rings of values."""
