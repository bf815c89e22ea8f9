"""The lab: a whole swarm of real processes on this machine, its experiment and the report."""
