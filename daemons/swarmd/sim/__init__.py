"""Simulation of a vehicle with its sensors and motors, behind the interfaces of a real one (S1.77).

The drivers of its sensors are in `hal`; the two meet on resources.
"""
