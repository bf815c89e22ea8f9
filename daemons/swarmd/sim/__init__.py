"""Simulation of the vehicle and its sensors, behind the same interfaces as a real one (S1.77)."""
