"""Computations of the lidar, without threads: from packets to points, and from points to obstacles."""
