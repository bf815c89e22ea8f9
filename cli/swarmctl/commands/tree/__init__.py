"""The `tree` commands: list, draw, read and watch resources; `swarmctl.resources.access` sets them."""
