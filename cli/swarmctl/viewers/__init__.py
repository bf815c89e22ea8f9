"""Forms in which people view the swarm: its topology as a picture, log entries as a file for viewers.

Shared by commands and by the report of a lab; reads neither nodes nor logs.
"""
