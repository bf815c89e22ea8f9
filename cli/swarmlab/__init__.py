"""The lab: a swarm of real processes on one machine, its experiment and its report.

`command` and `container` are its entry points, `experiment` runs one experiment from the first process to the
report; below them, each on top of the next: `report`, `run`, `provision`, `measure`. Stands on `swarmctl`,
which never imports it. Modules that need numpy or matplotlib (extra `lab`) are imported when a report is
computed.
"""
