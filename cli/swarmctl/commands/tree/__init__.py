"""The `tree` commands: list, draw, read and watch resources; `swarmctl.tree_set` sets them."""
