"""`hold`, `land` and `return`; `swarmctl.vehicles` has their logic, shared with `mission abort`."""
