"""Commands of `tree` that list, draw, read and watch resources; `swarmctl.resources.access` sets them."""
