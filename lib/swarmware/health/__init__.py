"""Health checks of any module: data at a frequency → criterion → state → actions (S1.20–23, S1.28).

Here live the judgement of a check, the usual criteria, conditions that a module states itself, and the
module's own part of the monitoring; faults and the state of the platform are the daemon's.
"""
