"""The `log` commands: query, follow, export and count log entries."""
