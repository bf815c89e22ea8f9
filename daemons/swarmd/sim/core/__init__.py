"""Sans-io core of the simulation: models of vehicle, sensors, battery; no input, output or clock."""
