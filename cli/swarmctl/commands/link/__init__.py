"""The `link` commands: neighbours of a platform."""
