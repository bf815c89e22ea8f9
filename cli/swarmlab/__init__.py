"""The lab: a swarm of real processes on one machine, its experiment and its report.

Stands on `swarmctl`, which never imports it. Modules that need numpy or matplotlib (extra `lab`) are
imported when a report is computed.
"""
