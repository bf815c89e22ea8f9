"""The hardware abstraction: devices become resources, each driver in its own period (S2.2, S2.5)."""
