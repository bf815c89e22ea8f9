"""Files of nodes: sent, fetched, listed."""
