"""Time synchronisation: one conversion function per hardware unit; clocks are never set."""
