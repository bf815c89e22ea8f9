"""Runtime of cores: their contract, driver and instants; atomic replacement of files, restarts, slow steps.

Contains no decision of a daemon, and does not use frames, resources or nodes.
"""
