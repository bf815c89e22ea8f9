"""The `time` commands: conversions between the clocks of nodes."""
