"""Computations of the lidar: from packets to points, from points to obstacles; arrays, no threads."""
