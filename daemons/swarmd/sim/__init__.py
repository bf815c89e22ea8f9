"""Simulation of a vehicle with its sensors and motors, behind the interfaces of a real vehicle (S1.77).

The drivers of the sensors are in `hal`, which is connected with the simulation by resources only.
"""
