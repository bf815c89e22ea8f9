"""The `config` commands: files of a node, and live settings."""
