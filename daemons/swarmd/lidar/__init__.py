"""Lidar: turns the packets of a rotating lidar into points and into distances to obstacles, in two threads.

Drivers of devices belong in `hal`, avoidance in `navigator`.
"""
