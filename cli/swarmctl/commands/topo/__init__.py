"""The command `topo`: the links of the swarm as a table, a graph or a picture."""
