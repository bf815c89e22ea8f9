"""The commands hold, land and return; their logic, shared with `mission abort`, is in `swarmctl.vehicles`."""
