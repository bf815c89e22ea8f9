"""hold, land and return; their logic is `swarmctl.manoeuvres`, which `mission abort` needs as well."""
