"""Geometry of positions and motion: geodesy, courses, formations, obstacles of a world.

Pure functions of positions; the navigator has the control of a vehicle.
"""
