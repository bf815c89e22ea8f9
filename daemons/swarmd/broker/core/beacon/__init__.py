"""The beacon: its parts and their bytes, its rate, the period it declares.

Independent of neighbours and boards: `beacon_protocol`, in the layer above, composes the beacons.
"""
