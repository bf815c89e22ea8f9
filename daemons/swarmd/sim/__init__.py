"""The vehicle and its sensors, simulated: the rest of the node cannot tell it from a real one (S1.77)."""
