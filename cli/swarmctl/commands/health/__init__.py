"""State, checks and faults of platforms."""
