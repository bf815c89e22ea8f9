"""Routes to all nodes: the rows of neighbours, feasibility distances, and the chosen next hops."""
