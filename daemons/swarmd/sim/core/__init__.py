"""Pure parts of the simulation: vehicles, sensor errors, battery, contacts; no input, output or clock."""
