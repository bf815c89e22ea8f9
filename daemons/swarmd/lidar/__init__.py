"""Lidar: the packets of a rotating lidar as points, and as distances to obstacles; two working threads.

Drivers of devices belong in `hal`, avoidance in `navigator`.
"""
