"""Decisions of the simulation: models of vehicle, sensors and battery; no input, output or clock."""
