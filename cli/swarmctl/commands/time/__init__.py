"""The commands of `time`: conversions between the clocks of nodes, with their error bounds."""
