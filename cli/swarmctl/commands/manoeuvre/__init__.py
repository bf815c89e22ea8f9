"""The commands hold, land and return; `swarmctl.manoeuvres` has their logic, which `mission abort` shares."""
