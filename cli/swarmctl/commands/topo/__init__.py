"""The graph of links."""
