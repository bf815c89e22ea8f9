"""Measurements: load of this machine, recorded tracks, clock, formation and traffic figures.

Pure functions on arrays and one reader of recordings; no process is started and no page is written here.
"""
