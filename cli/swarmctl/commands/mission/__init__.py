"""The `mission` commands: check, start, follow and abort missions."""
