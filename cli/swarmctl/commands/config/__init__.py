"""Settings: files of a node, and live ones."""
