"""The commands of `health`: states, checks and faults of platforms, and the removal of faults."""
