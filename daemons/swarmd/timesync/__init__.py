"""Time synchronisation: one conversion function per hardware unit, no clock is ever set."""
