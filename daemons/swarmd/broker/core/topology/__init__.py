"""Neighbours, links, nodes and routes: what beacons say of who reaches whom, and at which cost.

Decides no forwarding of a single frame; reads `beacon`.
"""
