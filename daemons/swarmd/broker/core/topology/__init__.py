"""Neighbours, links, nodes and routes, derived from beacons: reachability and cost.

The forwarding of frames is in `forwarding`.
"""
