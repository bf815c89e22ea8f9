"""Health monitor: data → criterion → state → action; faults; the logical state of the platform."""
