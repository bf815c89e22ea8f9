"""The commands of `node`: the table of all nodes, and what one node says of itself."""
