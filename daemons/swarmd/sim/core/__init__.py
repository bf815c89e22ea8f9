"""Decisions of the simulation, without input, output or clock: models of vehicle, sensors and battery."""
