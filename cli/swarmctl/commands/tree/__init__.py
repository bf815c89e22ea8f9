"""Resources: list, draw, read, watch; setting them is in `swarmctl.tree_set`, for `config set` as well."""
