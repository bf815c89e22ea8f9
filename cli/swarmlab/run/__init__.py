"""The processes of a lab while they live: start and end, load limits, observation of swarm and mission.

What a lab consists of is decided in `provision`; figures are computed in `report`, after the run.
"""
