"""The `traffic` commands: counters and rates of a broker."""
