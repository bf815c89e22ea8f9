"""The beacon: its parts and their bytes, its rate, the period it declares.

Knows no neighbour and no board: what is sent is composed in `beacon_protocol`, above.
"""
