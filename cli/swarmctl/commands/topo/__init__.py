"""The `topo` command: the graph of links."""
