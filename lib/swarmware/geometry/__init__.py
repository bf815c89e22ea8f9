"""Where vehicles are and how they move: geodesy, courses, formations, the obstacles of a world.

Pure functions of positions; how a vehicle is controlled lives in its navigator.
"""
