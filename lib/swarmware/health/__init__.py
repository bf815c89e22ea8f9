"""Health checks of any module: data at a frequency → criterion → state → actions (S1.20–23, S1.28).

Contains the debouncer of a check, the usual criteria, conditions that a module reports itself, and the
module's part of the monitoring. Faults and the state of the platform belong to the daemon.
"""
