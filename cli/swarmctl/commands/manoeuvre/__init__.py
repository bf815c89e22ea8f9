"""`swarmctl manoeuvre`."""
