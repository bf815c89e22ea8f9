"""The `app` commands: applications of the nodes."""
