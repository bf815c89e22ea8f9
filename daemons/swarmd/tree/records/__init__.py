"""Records of the tree's work: changes, denied requests, statistics."""
