"""The commands of `tree`: list, draw, read and watch resources; `swarmctl.resources.access` sets them."""
